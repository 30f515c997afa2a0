"""Logger that writes metrics.csv: one row for each epoch, with everything that was logged."""

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
"""Key of the rows of all epochs in checkpoints."""


class MetricsFile(Logger):
    """Logger that collects a row for each epoch, written atomically whenever a checkpoint is saved.

    Args:
        path: path of the file.
        rows: rows of the epochs before, if the training goes on.
    """

    def __init__(self, path: Path, rows: Sequence[Mapping[str, Any]] = ()) -> None:
        super().__init__()
        self.path = path
        self.rows: dict[int, dict[str, Any]] = {int(row["epoch"]): dict(row) for row in rows}

    @property
    def name(self) -> str:
        """Name of the logger, as Lightning requires."""
        return "metrics"

    @property
    def version(self) -> str:
        """Version of the logger, as Lightning requires."""
        return ""

    def log_hyperparams(self, *arguments: Any, **options: Any) -> None:
        """Do nothing: hyperparameters are in config.yaml."""

    @rank_zero_only
    def log_metrics(self, metrics: Mapping[str, float | int], step: int | None = None) -> None:
        """Add metrics to the row of their epoch; ignore those without an epoch."""
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
        """Write all rows after a success; after a failure do nothing, lest another error hide the first."""
        if status == "success":
            self.save()


class RowsInCheckpoints(Callback):
    """Saves the rows in every checkpoint: the file may have rows of epochs that a resumed training repeats.

    Args:
        table: the logger that has the rows.
    """

    def __init__(self, table: MetricsFile) -> None:
        self.table = table

    def on_save_checkpoint(
        self, trainer: Trainer, pl_module: LightningModule, checkpoint: dict[str, Any]
    ) -> None:
        """Add the rows."""
        checkpoint[ROWS] = [dict(row) for row in self.table.rows.values()]


def _place(name: str) -> tuple[int, str]:
    """Sort key of a column: epoch and step come first."""
    return ((name not in ("epoch", "step")), name)
