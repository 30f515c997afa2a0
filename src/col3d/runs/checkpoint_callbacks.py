"""The checkpoint that a training goes on from, and that of its best epoch."""

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
"""Where Lightning keeps the progress of a validation, among that of its loops."""


class LastCheckpoint(Checkpoint):
    """Keeps all that a training needs to go on: after each epoch, every so often within, and to stop.

    It saves between two steps of the optimiser, so that no gradient is lost; in the middle of a validation it
    saves what goes on with that validation from its beginning. Loggers write what they have first.

    Args:
        path: of the file.
        minutes: between two savings within an epoch; 0 saves after every step.
        stop: what may ask for the end.
    """

    def __init__(self, path: Path, minutes: float, stop: StopSignals | None = None) -> None:
        self.path, self.seconds, self.stop = path, 60 * minutes, stop or StopSignals()

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Hold signals back from now on, and begin to count the minutes."""
        self.stop.hold()
        self.saved = time.monotonic()

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """Save where it is time, or where it is asked to stop."""
        loop = trainer.fit_loop
        if loop._should_accumulate() or loop.epoch_loop._num_ready_batches_reached():
            return  # gradients that a step is still to use, or the end of the epoch, which saves
        due = time.monotonic() - self.saved >= self.seconds
        if _any(trainer, due or self.stop.pending is not None):
            self._save(trainer)
            self._stop_if_asked(trainer)

    def on_validation_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Find out how many batches all processes validate."""
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
        """Save and stop where it is asked for."""
        if batch_idx < self.common_batches and _any(trainer, self.stop.pending is not None):
            self._save(trainer)
            self._stop_if_asked(trainer)

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Save."""
        self._save(trainer)
        self._stop_if_asked(trainer)

    def on_train_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """All is saved: signals need not wait any more."""
        self.stop.release()

    def on_save_checkpoint(
        self, trainer: Trainer, pl_module: LightningModule, checkpoint: dict[str, Any]
    ) -> None:
        """Say of a validation that it is under way: Lightning then begins it again, and no other way."""
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


def _any(trainer: Trainer, wish: bool) -> bool:
    """Whether any process wishes it; all have to ask."""
    return wish if trainer.world_size == 1 else trainer.strategy.reduce_boolean_decision(wish, all=False)


class BestCheckpoint(ModelCheckpoint):
    """Keeps the epoch with the lowest value of a metric, of those where that is a finite number.

    Args:
        path: of the file.
        monitor: the metric.

    Attributes:
        path: of the file.
        metrics: all that was logged of the best epoch.
    """

    metrics: dict[str, float]

    def __init__(self, path: Path, monitor: str) -> None:
        super().__init__(path.parent, filename=path.stem, monitor=monitor, enable_version_counter=False)
        self.path, self.metrics = path, {}

    def check_monitor_top_k(self, trainer: Trainer, current: Tensor | None = None) -> bool:
        """Whether the epoch is among the best."""
        finite = current is not None and bool(torch.as_tensor(current).isfinite())
        best = finite and super().check_monitor_top_k(trainer, current)
        if best:
            self.metrics = {name: value.item() for name, value in trainer.callback_metrics.items()}
        return best

    def state_dict(self) -> dict[str, Any]:
        """What a training that goes on has to know."""
        return super().state_dict() | {"metrics": self.metrics}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """The same, in whatever folder the run lies now."""
        before = str(state_dict["dirpath"])
        here = {key: _moved(value, before, str(self.dirpath)) for key, value in state_dict.items()}
        self.metrics = here.pop("metrics")
        super().load_state_dict(here)


def _moved(value: Any, before: str, now: str) -> Any:
    """A path, or values by path, in another folder."""
    if isinstance(value, dict):
        return {_moved(key, before, now): content for key, content in value.items()}
    return now + value.removeprefix(before) if isinstance(value, str) and value.startswith(before) else value


class About(Callback):
    """Writes into every checkpoint where it comes from.

    Args:
        facts: plain values; the metrics at that time are put beside them.
    """

    KEY = "about"

    def __init__(self, facts: Mapping[str, Any]) -> None:
        self.facts = dict(facts)

    def on_save_checkpoint(
        self, trainer: Trainer, pl_module: LightningModule, checkpoint: dict[str, Any]
    ) -> None:
        """Add them."""
        metrics = {name: value.item() for name, value in trainer.callback_metrics.items()}
        checkpoint[self.KEY] = {**self.facts, "metrics": metrics}
