"""Construction of Lightning's Trainer."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from lightning import Callback, Trainer
from lightning.fabric.plugins.environments import SLURMEnvironment
from lightning.pytorch.callbacks import Checkpoint, ModelSummary
from lightning.pytorch.loggers import Logger
from lightning.pytorch.profilers import AdvancedProfiler, PyTorchProfiler, SimpleProfiler

from col3d.runs.checkpoints import CheckpointFiles
from col3d.runs.environment import device_for
from col3d.training.callbacks.unfreeze import Unfreeze
from col3d.training.trainer_options import TrainerOptions

PROFILERS: dict[str, Callable[..., Any]] = {
    "simple": SimpleProfiler,
    "advanced": AdvancedProfiler,
    "pytorch": PyTorchProfiler,
}


def make_trainer(
    given: TrainerOptions,
    callbacks: list[Callback],
    loggers: list[Logger],
    adversarial: bool = False,
    folder: Path | None = None,
) -> Trainer:
    """Build Lightning's Trainer; samplers are our own, so that a test counts each frame once under DDP.

    Args:
        given: options of the Trainer.
        callbacks: callbacks of the Trainer.
        loggers: loggers of the Trainer.
        adversarial: whether two networks are trained in turn.
        folder: folder of the run, where a profiler writes.
    """
    # Two networks that are trained in turn, or a frozen encoder, leave some parameters without gradients.
    in_turn = adversarial or any(isinstance(callback, Unfreeze) for callback in callbacks)
    parts_unused = in_turn and (given.strategy == "ddp" or given.processes != 1)
    strategy = "ddp_find_unused_parameters_true" if parts_unused else given.strategy
    return Trainer(
        max_epochs=given.max_epochs,
        accelerator=device_for(given.accelerator).type,  # MPS is not supported: metrics are float64
        devices=given.devices,
        strategy=strategy,
        precision=given.precision,
        gradient_clip_val=None if adversarial else given.gradient_clip,  # that task clips by itself
        accumulate_grad_batches=given.accumulate,
        deterministic=given.deterministic,
        limit_train_batches=given.limit_train_batches,
        limit_val_batches=given.limit_val_batches,
        limit_test_batches=given.limit_test_batches,
        overfit_batches=given.overfit_batches or 0.0,
        check_val_every_n_epoch=given.check_val_every_n_epoch or 1,
        min_epochs=given.min_epochs,
        num_nodes=given.num_nodes,
        gradient_clip_algorithm=None if adversarial else given.gradient_clip_algorithm,
        sync_batchnorm=bool(given.sync_batchnorm),
        benchmark=given.benchmark,
        detect_anomaly=bool(given.detect_anomaly),
        profiler=_profiler(given.profiler, folder),
        callbacks=callbacks,
        logger=loggers or False,
        plugins=_plugins(),
        use_distributed_sampler=False,
        log_every_n_steps=given.log_every_n_steps or 1,
        num_sanity_val_steps=0,
        enable_model_summary=any(isinstance(callback, ModelSummary) for callback in callbacks),
        enable_progress_bar=sys.stdout.isatty(),
        enable_checkpointing=any(isinstance(callback, Checkpoint) for callback in callbacks),
    )


def _profiler(name: str | None, folder: Path | None) -> Any:
    """Build a profiler that writes into the folder `profile` of a run."""
    if name is None or folder is None:
        return None
    place = folder / "profile"
    place.mkdir(parents=True, exist_ok=True)
    return PROFILERS[name](dirpath=place, filename=name)


def _plugins() -> list[Any]:
    """Return plugins: atomic checkpoints, and on a cluster no requeueing by Lightning."""
    cluster = [SLURMEnvironment(auto_requeue=False)] if SLURMEnvironment.detect() else []
    return [CheckpointFiles(), *cluster]
