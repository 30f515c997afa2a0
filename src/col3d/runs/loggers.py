"""Registered loggers: those of Lightning, set up to write into a run's folder and to resume.

A logger's function receives the `folder` of the run; `run`, an identifier that stays the same when the run
goes on; and `config`, the options of the training as plain values.
"""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import ValidationError

from col3d.errors import UserError
from col3d.registry import register_logger

ID, MLFLOW_ID = "wandb_id.txt", "mlflow_id.txt"
"""Files with the identifier of a run at a service, with which a training that goes on is logged."""
PATIENCE = 30
"""Seconds to wait for W&B's server."""


@register_logger("wandb", needs=("wandb",), install="wandb")
def wandb(
    folder: Path,
    config: Mapping[str, Any],
    project: str = "col3d",
    offline: bool = True,
    prefix: str | None = None,
    log_model: Literal["all"] | bool = False,
) -> Any:
    """Weights & Biases; upload an offline run with `wandb sync`.

    Without a key, or where the server cannot be reached, W&B's files are kept in the folder.

    Raises:
        UserError: an environment variable of W&B has a value that it does not know, or the project a name.
    """
    import wandb as service
    from lightning.pytorch.loggers import WandbLogger

    _check_environment()

    def started(offline: bool) -> Any:
        logger = WandbLogger(
            name=folder.name,
            save_dir=folder,
            project=project,
            offline=offline,
            prefix=prefix or "",
            log_model=log_model and not offline,
            id=_id(folder / ID),
            resume=None if offline else "allow",
            config=dict(config),
            settings=service.Settings(init_timeout=PATIENCE, login_timeout=PATIENCE),
        )
        _ = logger.experiment  # connects
        return logger

    if not offline:
        try:
            if not service.login(prompt=False, timeout=PATIENCE):
                raise service.errors.UsageError("there is no key; `wandb login` asks for one")
            return started(offline=False)
        except service.errors.Error as error:
            reason = str(error).splitlines()[0].rstrip(".")
            print(f"note: W&B goes on offline: {reason}; upload {folder}/wandb with `wandb sync`", flush=True)
            service.teardown()
    return started(offline=True)


@register_logger("tensorboard", needs=("tensorboard", "tensorboardX"), install="col3d[tensorboard]")
def tensorboard(folder: Path, run: str, prefix: str | None = None, default_hp_metric: bool = False) -> Any:
    """TensorBoard: event files in the folder `tensorboard`; `tensorboard --logdir runs` shows all runs."""
    from lightning.pytorch.loggers import TensorBoardLogger

    return TensorBoardLogger(
        folder, "tensorboard", version=run, prefix=prefix or "", default_hp_metric=default_hp_metric
    )


@register_logger("mlflow", needs=("mlflow",), install="col3d[mlflow]")
def mlflow(
    folder: Path,
    experiment_name: str = "col3d",
    tracking_uri: str | None = None,
    tags: dict[str, str] | None = None,
    prefix: str | None = None,
    artifact_location: str | None = None,
    log_model: Literal["all"] | bool = False,
    synchronous: bool | None = None,
) -> Any:
    """MLflow, in the folder `mlruns` unless `tracking_uri` names a server."""
    from lightning.pytorch.loggers import MLFlowLogger

    path = folder / MLFLOW_ID
    logger = MLFlowLogger(
        experiment_name,
        folder.name,
        tracking_uri,
        tags,
        str(folder / "mlruns"),
        log_model,
        prefix or "",
        artifact_location,
        path.read_text(encoding="utf-8").strip() if path.is_file() else None,
        synchronous,
    )
    path.write_text(f"{logger.run_id}\n", encoding="utf-8")
    return logger


@register_logger("comet", needs=("comet_ml",), install="comet-ml")
def comet(
    run: str,
    workspace: str | None = None,
    project: str = "col3d",
    online: bool = True,
    prefix: str | None = None,
) -> Any:
    """Comet; the key is in the environment, COMET_API_KEY."""
    from lightning.pytorch.loggers import CometLogger

    key = run.ljust(32, "0")  # experiments of Comet have names of 32 letters and digits or more
    return CometLogger(workspace=workspace, project=project, online=online, prefix=prefix, experiment_key=key)


@register_logger("litlogger", needs=("litlogger",), install="litlogger")
def litlogger(folder: Path, run: str, teamspace: str | None = None, log_model: bool = False) -> Any:
    """Lightning's own service."""
    from lightning.pytorch.loggers import LitLogger

    return LitLogger(folder, f"{folder.name}-{run}", teamspace, log_model=log_model)


def _check_environment() -> None:
    import wandb as service

    try:
        service.Settings().update_from_env_vars(dict(os.environ))
    except ValidationError as error:
        [fault, *_] = error.errors()
        name, rule = f"WANDB_{str(fault['loc'][0]).upper()}", fault["msg"]
        raise UserError(f"{name} of the environment: {rule}; got {fault['input']!r}") from None


def _id(path: Path) -> str:
    known = path.read_text(encoding="utf-8").strip() if path.is_file() else ""
    if not known:
        known = os.urandom(4).hex()
        path.write_text(f"{known}\n", encoding="utf-8")
    return known
