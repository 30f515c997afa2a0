"""Where metrics are logged: metrics.csv, and Weights & Biases where it is asked for."""

import csv
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from lightning.pytorch.loggers import CSVLogger, Logger
from torch import Tensor

from col3d.app.config import TrainOptions


def csv_logger(folder: Path, epoch: int | None) -> CSVLogger:
    """Logs into metrics.csv; a run that goes on keeps the rows up to the epoch of its checkpoint."""
    path = folder / "metrics.csv"
    there = epoch is not None and path.is_file()
    before = list(csv.DictReader(path.read_text().splitlines())) if there else []
    kept = [
        i + 1 for i, row in enumerate(before) if row.get("train/loss") and int(row["epoch"]) <= (epoch or 0)
    ]
    logger = CSVLogger(folder, name="", version="")
    for row in before[: max(kept, default=0)]:  # later epochs are logged again
        values: dict[str, Tensor | float] = {
            k: int(v) if v.isdigit() else float(v) for k, v in row.items() if v and k != "step"
        }
        logger.log_metrics(values, int(row["step"]))
    return logger


@contextmanager
def wandb_run(options: TrainOptions, folder: Path) -> Iterator[list[Logger]]:
    """The logger, imported only now; a run that ends in an exception is marked as failed."""
    if options.logger.name != "wandb":
        yield []
        return
    import wandb
    from lightning.pytorch.loggers import WandbLogger

    logger = WandbLogger(
        name=folder.name,
        save_dir=folder,
        project=options.logger.project,
        offline=options.logger.offline,
        config=options.model_dump(mode="json"),
    )
    code = 1
    try:
        yield [logger]
        code = 0
    finally:
        wandb.finish(exit_code=code)
