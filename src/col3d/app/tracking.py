"""Weights & Biases, where it is asked for."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from lightning.pytorch.loggers import Logger
from pydantic import ValidationError

from col3d.app.config import TrainOptions
from col3d.app.rank import is_first
from col3d.checks import UserError

ID = "wandb_id.txt"
"""Under which name W&B knows the run of a folder, for a training that goes on."""
PATIENCE = 30
"""Seconds to wait for W&B's server."""


@contextmanager
def wandb_run(options: TrainOptions, folder: Path) -> Iterator[list[Logger]]:
    """The logger, imported only now; a run that ends in an exception is marked as failed.

    Without a key, or where the server cannot be reached, W&B's files are kept in the folder.

    Raises:
        UserError: an environment variable of W&B has a value that it does not know.
    """
    if options.logger.name != "wandb" or not is_first():
        yield []
        return
    import wandb

    code = 1
    try:
        yield [_logger(options, folder)]
        code = 0
    finally:
        try:
            wandb.finish(exit_code=code)
        except Exception as error:  # whatever became of the server: the training is what it is
            print(f"note: W&B did not end well ({type(error).__name__}: {error})", flush=True)


def _logger(options: TrainOptions, folder: Path) -> Logger:
    import wandb
    from lightning.pytorch.loggers import WandbLogger

    _check_environment()

    def started(offline: bool) -> Logger:
        logger = WandbLogger(
            name=folder.name,
            save_dir=folder,
            project=options.logger.project,
            offline=offline,
            id=_id(folder),
            resume=None if offline else "allow",
            config=options.model_dump(mode="json"),
            settings=wandb.Settings(init_timeout=PATIENCE, login_timeout=PATIENCE),
        )
        _ = logger.experiment  # connects
        return logger

    if not options.logger.offline:
        try:
            if not wandb.login(prompt=False, timeout=PATIENCE):
                raise wandb.errors.UsageError("there is no key; `wandb login` asks for one")
            return started(offline=False)
        except wandb.errors.Error as error:
            reason = str(error).splitlines()[0].rstrip(".")
            print(f"note: W&B goes on offline: {reason}; upload {folder}/wandb with `wandb sync`", flush=True)
            wandb.teardown()
    return started(offline=True)


def _check_environment() -> None:
    import wandb

    try:
        wandb.Settings().update_from_env_vars(dict(os.environ))
    except ValidationError as error:
        [fault, *_] = error.errors()
        name, rule = f"WANDB_{str(fault['loc'][0]).upper()}", fault["msg"]
        raise UserError(f"{name} of the environment: {rule}; got {fault['input']!r}") from None


def _id(folder: Path) -> str:
    path = folder / ID
    known = path.read_text(encoding="utf-8").strip() if path.is_file() else ""
    if not known:
        known = os.urandom(4).hex()
        path.write_text(f"{known}\n", encoding="utf-8")
    return known
