"""metrics.csv: all that was logged of an epoch in a row."""

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from lightning import Callback, LightningModule, Trainer
from lightning.pytorch.loggers import Logger
from lightning.pytorch.utilities.rank_zero import rank_zero_only

from col3d.io.atomic import write_whole

ROWS = "rows"
"""Where checkpoints keep the rows of the epochs before."""


class MetricsFile(Logger):
    """Rows by epoch, written in one step whenever a checkpoint is.

    Args:
        path: of the file.
        rows: of the epochs that a training which goes on has behind it.
    """

    def __init__(self, path: Path, rows: Sequence[Mapping[str, Any]] = ()) -> None:
        super().__init__()
        self.path = path
        self.rows: dict[int, dict[str, Any]] = {int(row["epoch"]): dict(row) for row in rows}

    @property
    def name(self) -> str:
        """As loggers have one."""
        return "metrics"

    @property
    def version(self) -> str:
        """As loggers have one."""
        return ""

    def log_hyperparams(self, *arguments: Any, **options: Any) -> None:
        """They are in config.yaml."""

    @rank_zero_only
    def log_metrics(self, metrics: Mapping[str, float | int], step: int | None = None) -> None:
        """Add to the row of the epoch that the metrics name; those of no epoch belong in no row."""
        if "epoch" in metrics:
            self.rows.setdefault(int(metrics["epoch"]), {}).update(
                {**metrics, "epoch": int(metrics["epoch"]), **({} if step is None else {"step": step})}
            )

    @rank_zero_only
    def save(self) -> None:
        """Write all rows."""
        columns = sorted({name for row in self.rows.values() for name in row}, key=_place)
        text = io.StringIO(newline="")
        writer = csv.DictWriter(text, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(row for _, row in sorted(self.rows.items()))
        write_whole(self.path, text.getvalue())

    def finalize(self, status: str) -> None:
        """Write what is not yet written; a training that failed has said why, whatever comes of this."""
        if status == "success":
            self.save()


class RowsInCheckpoints(Callback):
    """Keeps the rows in every checkpoint: what lies in the file may be of epochs that are to be done again.

    Args:
        table: whose rows.
    """

    def __init__(self, table: MetricsFile) -> None:
        self.table = table

    def on_save_checkpoint(
        self, trainer: Trainer, pl_module: LightningModule, checkpoint: dict[str, Any]
    ) -> None:
        """Add them."""
        checkpoint[ROWS] = [dict(row) for row in self.table.rows.values()]


def _place(name: str) -> tuple[int, str]:
    """Epoch and step come first."""
    return ((name not in ("epoch", "step")), name)
