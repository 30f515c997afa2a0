"""Creation and closing of the requested loggers."""

import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from inspect import signature
from pathlib import Path
from typing import Any

from lightning.pytorch.loggers import Logger

from col3d.errors import UserError
from col3d.registry import LOGGERS
from col3d.registry.schema import Options
from col3d.runs.rank import is_first

OURS = "col3d"


@contextmanager
def loggers_of(
    chosen: Mapping[str, Options], config: Mapping[str, Any], folder: Path, run: str, goes_on: bool
) -> Iterator[list[Logger]]:
    """Open loggers for the block; one that can marks a run that ends in an exception as failed.

    Args:
        chosen: options of loggers by name.
        config: all options of the training, as plain values.
        folder: folder of the run.
        run: identifier of the run, which stays the same when it goes on.
        goes_on: whether the run goes on; its options have then been logged before.

    Raises:
        UserError: a logger cannot be created.
    """
    if not is_first():
        yield []
        return
    made, status = [_made(name, own, config, folder, run, goes_on) for name, own in chosen.items()], "failed"
    try:
        yield [*made]
        status = "success"
    finally:
        for name, logger in zip(chosen, made, strict=True):
            _end(name, logger, status)


def _made(
    name: str, own: Options, config: Mapping[str, Any], folder: Path, run: str, goes_on: bool
) -> Logger:
    part = LOGGERS[name]
    supplied = {"folder": folder, "run": run, "config": dict(config)}
    takes = signature(part.build).parameters
    try:
        given = {key: value for key, value in supplied.items() if key in takes}
        logger: Logger = part.made(part.build(**given, **own.model_dump()), "log_metrics")
        if "config" not in takes and not goes_on:
            logger.log_hyperparams(_flat(supplied["config"]))
    except UserError:
        raise
    except Exception as error:
        if part.package != OURS:
            raise
        message = " ".join(str(error).split())[:300]
        raise UserError(f"logger.{name}: {type(error).__name__}: {message}") from None
    return logger


def _flat(node: Any, place: str = "") -> dict[str, Any]:
    """Flatten options to a dict by dotted names."""
    if not isinstance(node, dict):
        return {place: node if isinstance(node, bool | int | float | str) else str(node)}
    inside = (_flat(value, f"{place}.{key}".strip(".")) for key, value in node.items())
    return {name: value for part in inside for name, value in part.items()}


def _end(name: str, logger: Logger, status: str) -> None:
    try:
        logger.finalize(status)
        if name == "wandb":
            sys.modules["wandb"].finish(exit_code=int(status != "success"))
    except Exception as error:  # a failure of a server does not change the result
        label = "W&B" if name == "wandb" else name
        print(f"note: {label} did not end well ({type(error).__name__}: {error})", flush=True)
