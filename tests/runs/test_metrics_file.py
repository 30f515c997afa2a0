"""metrics.csv has a row for each epoch, and those of epochs that are done again stand there once."""

import csv
from pathlib import Path
from typing import Any
from unittest.mock import Mock

from lightning import LightningModule, Trainer

from col3d.runs.metrics_file import ROWS, MetricsFile, RowsInCheckpoints


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_all_that_is_logged_of_an_epoch_is_one_row(tmp_path: Path) -> None:
    table = MetricsFile(tmp_path / "metrics.csv")
    table.log_metrics({"epoch": 0, "val/loss": 2.0}, 5)
    table.log_metrics({"epoch": 0, "train/loss": 3.0}, 5)
    table.log_metrics({"epoch": 1, "val/loss": 1.0}, 11)
    table.log_metrics({"stray": 1.0}, 11)
    table.save()
    assert rows_of(table.path) == [
        {"epoch": "0", "step": "5", "train/loss": "3.0", "val/loss": "2.0"},
        {"epoch": "1", "step": "11", "train/loss": "", "val/loss": "1.0"},
    ]
    assert [path.name for path in tmp_path.iterdir()] == ["metrics.csv"]


def test_epochs_after_the_checkpoint_are_logged_again(tmp_path: Path) -> None:
    before = MetricsFile(tmp_path / "metrics.csv")
    callback, checkpoint = RowsInCheckpoints(before), dict[str, Any]()
    for epoch in range(4):
        before.log_metrics({"epoch": epoch, "train/loss": epoch + 0.1}, epoch)
        if epoch == 1:
            callback.on_save_checkpoint(Mock(spec=Trainer), Mock(spec=LightningModule), checkpoint)
    before.save()
    after = MetricsFile(tmp_path / "metrics.csv", checkpoint[ROWS])
    after.log_metrics({"epoch": 2, "train/loss": 9.0}, 2)
    after.save()
    assert [(row["epoch"], row["train/loss"]) for row in rows_of(after.path)] == [
        ("0", "0.1"), ("1", "1.1"), ("2", "9.0"),
    ]  # fmt: skip
    anew = MetricsFile(tmp_path / "metrics.csv")
    anew.save()
    assert rows_of(anew.path) == []
