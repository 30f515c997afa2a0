"""The loggers that are asked for, beside metrics.csv."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from inspect import signature
from pathlib import Path
from typing import Any

from lightning.pytorch.loggers import Logger

from col3d.app.config import TrainOptions
from col3d.app.rank import is_first
from col3d.checks import UserError
from col3d.registry import LOGGERS

OURS = "col3d"


@contextmanager
def loggers_of(options: TrainOptions, folder: Path, run: str, goes_on: bool) -> Iterator[list[Logger]]:
    """The loggers; a run that ends in an exception is marked as failed where they can.

    Args:
        options: of the training.
        folder: of the run.
        run: which is the same whenever the run goes on.
        goes_on: whether it does; its options have been logged then.

    Raises:
        UserError: one cannot begin, in a line.
    """
    if not is_first():
        yield []
        return
    made, status = [_made(options, name, folder, run, goes_on) for name in options.logger], "failed"
    try:
        yield [*made]
        status = "success"
    finally:
        for name, logger in zip(options.logger, made, strict=True):
            _end(name, logger, status)


def _made(options: TrainOptions, name: str, folder: Path, run: str, goes_on: bool) -> Logger:
    part, own = LOGGERS[name], options.logger[name].model_dump()
    supplied = {"folder": folder, "run": run, "config": options.model_dump(mode="json")}
    takes = signature(part.build).parameters
    try:
        given = {key: value for key, value in supplied.items() if key in takes}
        logger: Logger = part.made(part.build(**given, **own), "log_metrics")
        if "config" not in takes and not goes_on:
            logger.log_hyperparams(_flat(supplied["config"]))
    except UserError:
        raise
    except Exception as error:
        if part.package != OURS:
            raise
        said = " ".join(str(error).split())[:300]
        raise UserError(f"logger.{name}: {type(error).__name__}: {said}") from None
    return logger


def _flat(node: Any, place: str = "") -> dict[str, Any]:
    """Options by dotted names."""
    if not isinstance(node, dict):
        return {place: node if isinstance(node, bool | int | float | str) else str(node)}
    inside = (_flat(value, f"{place}.{key}".strip(".")) for key, value in node.items())
    return {name: value for found in inside for name, value in found.items()}


def _end(name: str, logger: Logger, status: str) -> None:
    try:
        logger.finalize(status)
        if name == "wandb":
            sys.modules["wandb"].finish(exit_code=int(status != "success"))
    except Exception as error:  # whatever became of a server: the training is what it is
        said = "W&B" if name == "wandb" else name
        print(f"note: {said} did not end well ({type(error).__name__}: {error})", flush=True)
