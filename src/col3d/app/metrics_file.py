"""metrics.csv: all that was logged of an epoch in a row."""

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lightning.pytorch.loggers import Logger
from lightning.pytorch.utilities.rank_zero import rank_zero_only


class MetricsFile(Logger):
    """Rows by epoch, written in one step whenever a checkpoint is.

    Args:
        path: of the file; a training that goes on keeps the rows of the epochs it has done.
        epochs: how many it has done.
    """

    def __init__(self, path: Path, epochs: int = 0) -> None:
        super().__init__()
        self.path = path
        self.rows: dict[int, dict[str, Any]] = {}
        if epochs and path.is_file():
            with path.open(newline="", encoding="utf-8") as file:
                rows = {int(row["epoch"]): row for row in csv.DictReader(file)}
            self.rows = {epoch: _filled(row) for epoch, row in rows.items() if epoch < epochs}

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
        partial = self.path.with_suffix(".partial")
        with partial.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, columns, lineterminator="\n")
            writer.writeheader()
            writer.writerows(row for _, row in sorted(self.rows.items()))
        partial.replace(self.path)

    def finalize(self, status: str) -> None:
        """Write what is not yet written; a training that failed has said why, whatever comes of this."""
        if status == "success":
            self.save()


def _filled(row: Mapping[str, str]) -> dict[str, str]:
    return {name: value for name, value in row.items() if value}


def _place(name: str) -> tuple[int, str]:
    """Epoch and step come first."""
    return ((name not in ("epoch", "step")), name)
