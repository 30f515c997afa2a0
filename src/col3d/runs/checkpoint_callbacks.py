"""Lightning callbacks that write checkpoints: the last one, to resume from, and that of the best epoch."""

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from lightning import Callback, LightningModule, Trainer
from lightning.pytorch.callbacks import Checkpoint, ModelCheckpoint
from torch import Tensor

from col3d.signals import Stopped, StopSignals

VALIDATION = "epoch_loop.val_loop.batch_progress"
"""Key of the validation's progress in the state of Lightning's fit loop."""


class LastCheckpoint(Checkpoint):
    """Saves the checkpoint to resume from: after each epoch, at intervals within it, and before a stop.

    It saves between two steps of the optimiser, so that no gradient is lost. A checkpoint from the middle of
    a validation resumes at the beginning of that validation. Loggers are saved first.

    Args:
        path: path of the file.
        minutes: interval between two checkpoints within an epoch; 0 saves after every step.
        stop: signals that ask the training to stop.
    """

    def __init__(self, path: Path, minutes: float, stop: StopSignals | None = None) -> None:
        self.path, self.seconds, self.stop = path, 60 * minutes, stop or StopSignals()

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Hold signals back from now on, and start the interval."""
        self.stop.hold()
        self.saved = time.monotonic()

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """Save if the interval is over, or save and stop if a signal is pending."""
        loop = trainer.fit_loop
        if loop._should_accumulate() or loop.epoch_loop._num_ready_batches_reached():
            return  # gradients are being accumulated, or the end of the epoch saves
        due = time.monotonic() - self.saved >= self.seconds
        if _any(trainer, due or self.stop.pending is not None):
            self._save(trainer)
            self._stop_if_asked(trainer)

    def on_validation_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Find the number of batches that every process validates."""
        own = torch.tensor(sum(trainer.num_val_batches), device=pl_module.device)
        self.common_batches = int(trainer.strategy.reduce(own, reduce_op="min"))

    def on_validation_batch_end(
        self,
        trainer: Trainer,
        pl_module: LightningModule,
        outputs: Any,
        batch: Any,
        batch_idx: int,
        dataloader_idx: int = 0,
    ) -> None:
        """Save and stop if a signal is pending."""
        if batch_idx < self.common_batches and _any(trainer, self.stop.pending is not None):
            self._save(trainer)
            self._stop_if_asked(trainer)

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Save, and stop if a signal is pending."""
        self._save(trainer)
        self._stop_if_asked(trainer)

    def on_train_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Release signals, because everything is saved."""
        self.stop.release()

    def on_save_checkpoint(
        self, trainer: Trainer, pl_module: LightningModule, checkpoint: dict[str, Any]
    ) -> None:
        """Mark a validation as started, without which Lightning would not begin it again on resumption."""
        if trainer.validating:
            progress = checkpoint["loops"]["fit_loop"][VALIDATION]
            none = {"ready": 0, "started": 0, "processed": 0, "completed": 0}
            progress |= {"total": none | {"ready": 1, "started": 1}, "current": none, "is_last_batch": False}

    def _save(self, trainer: Trainer) -> None:
        for logger in trainer.loggers:
            logger.save()
        trainer.save_checkpoint(self.path, weights_only=False)
        self.saved = time.monotonic()

    def _stop_if_asked(self, trainer: Trainer) -> None:
        if _any(trainer, self.stop.pending is not None):
            raise Stopped(self.stop.pending or 0)


def _any(trainer: Trainer, flag: bool) -> bool:
    """Whether a flag is set in any process; a collective that all processes have to call."""
    return flag if trainer.world_size == 1 else trainer.strategy.reduce_boolean_decision(flag, all=False)


class BestCheckpoint(ModelCheckpoint):
    """Keeps the epoch with the lowest value of a metric; values that are not finite are ignored.

    Args:
        path: path of the file.
        monitor: name of the metric.

    Attributes:
        path: path of the file.
        metrics: all metrics that were logged in the best epoch.
    """

    metrics: dict[str, float]

    def __init__(self, path: Path, monitor: str) -> None:
        super().__init__(path.parent, filename=path.stem, monitor=monitor, enable_version_counter=False)
        self.path, self.metrics = path, {}

    def check_monitor_top_k(self, trainer: Trainer, current: Tensor | None = None) -> bool:
        """Whether the epoch is the best one so far."""
        finite = current is not None and bool(torch.as_tensor(current).isfinite())
        best = finite and super().check_monitor_top_k(trainer, current)
        if best:
            self.metrics = {name: value.item() for name, value in trainer.callback_metrics.items()}
        return best

    def state_dict(self) -> dict[str, Any]:
        """Return the state, with the metrics of the best epoch."""
        return super().state_dict() | {"metrics": self.metrics}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Restore the state, with its paths changed to the run's current folder."""
        before = str(state_dict["dirpath"])
        state = {key: _moved(value, before, str(self.dirpath)) for key, value in state_dict.items()}
        self.metrics = state.pop("metrics")
        super().load_state_dict(state)


def _moved(value: Any, before: str, now: str) -> Any:
    """Replace the folder at the beginning of a path, or of a dict's keys."""
    if isinstance(value, dict):
        return {_moved(key, before, now): content for key, content in value.items()}
    return now + value.removeprefix(before) if isinstance(value, str) and value.startswith(before) else value


class About(Callback):
    """Writes the provenance of a checkpoint into it.

    Args:
        facts: plain values, to which the current metrics are added.
    """

    KEY = "about"

    def __init__(self, facts: Mapping[str, Any]) -> None:
        self.facts = dict(facts)

    def on_save_checkpoint(
        self, trainer: Trainer, pl_module: LightningModule, checkpoint: dict[str, Any]
    ) -> None:
        """Add the facts and metrics."""
        metrics = {name: value.item() for name, value in trainer.callback_metrics.items()}
        checkpoint[self.KEY] = {**self.facts, "metrics": metrics}
