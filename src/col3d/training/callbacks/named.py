"""Registration of those callbacks of Lightning that are safe to resume, and averages of weights."""

from collections.abc import Iterable
from typing import Any

import lightning.pytorch.callbacks as lightnings
from lightning import Callback, LightningModule, Trainer

from col3d.registry import CALLBACKS, register_callback

OFFERED = (
    *("DeviceStatsMonitor", "EarlyStopping", "LearningRateMonitor", "ModelSummary", "RichModelSummary"),
    "Timer",
)
BEST = "best.ckpt and last.ckpt are kept anyway, callbacks.checkpoint_minutes says how often"
BAR = "a terminal shows a progress bar anyway"
FUNCTIONS = "it is made of functions; register a class of your own with register_callback"
TRIES = "it would change options that the run is known by; sweep them, -m optimizer.lr=1e-4,1e-3"
FINETUNING = "take model.freeze=[encoder] model.unfreeze_at=EPOCH, which goes on after a kill"
REFUSED = {
    **dict.fromkeys(("ModelCheckpoint", "OnExceptionCheckpoint", "Checkpoint"), BEST),
    **dict.fromkeys(("ProgressBar", "RichProgressBar", "TQDMProgressBar"), BAR),
    **dict.fromkeys(("LambdaCallback", "ThroughputMonitor", "BasePredictionWriter", "Callback"), FUNCTIONS),
    **dict.fromkeys(("LearningRateFinder", "BatchSizeFinder"), TRIES),
    **dict.fromkeys(("BackboneFinetuning", "BaseFinetuning"), FINETUNING),
    "GradientAccumulationScheduler": "schedules could not know their steps; take trainer.accumulate",
    "StochasticWeightAveraging": "its weights would miss best.ckpt; take WeightAveraging",
    "ModelPruning": "a pruned training cannot go on from its checkpoint",
    "SpikeDetection": "no loader reads what it writes; a loss that is not finite ends the run anyway",
}
"""Callbacks of Lightning that conflict with what a training does by itself, and what to do instead."""


class Averages:
    """Mixin for averages of weights: correct checkpoints within a validation, where weights are exchanged."""

    exchanged = False

    def on_validation_epoch_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Validate the average."""
        super().on_validation_epoch_start(trainer, pl_module)  # type: ignore[misc]
        self.exchanged = True

    def on_validation_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Go back to the weights that are trained."""
        super().on_validation_epoch_end(trainer, pl_module)  # type: ignore[misc]
        self.exchanged = False

    def on_save_checkpoint(
        self, trainer: Trainer, pl_module: LightningModule, checkpoint: dict[str, Any]
    ) -> None:
        """Save the average and the trained weights, each under its own key."""
        super().on_save_checkpoint(trainer, pl_module, checkpoint)  # type: ignore[misc]
        if self.exchanged:
            average, learning = checkpoint["current_model_state"], checkpoint["state_dict"]
            checkpoint |= {"state_dict": average, "current_model_state": learning}


class WeightAveraging(Averages, lightnings.WeightAveraging):
    """The mean of the weights after all steps so far."""


class EMAWeightAveraging(Averages, lightnings.EMAWeightAveraging):
    """The exponential moving average of the weights."""


class StoppedEarly(Callback):
    """Keeps in checkpoints that a training has stopped early, which Lightning forgets on resumption."""

    KEY = "stopped_early"

    def on_save_checkpoint(
        self, trainer: Trainer, pl_module: LightningModule, checkpoint: dict[str, Any]
    ) -> None:
        """Save whether the training has stopped."""
        checkpoint[self.KEY] = bool(trainer.should_stop)

    def on_load_checkpoint(
        self, trainer: Trainer, pl_module: LightningModule, checkpoint: dict[str, Any]
    ) -> None:
        """Stop if the training had stopped."""
        trainer.should_stop = checkpoint.get(self.KEY) is True


CALLBACKS.refused.update(REFUSED)
for _name in OFFERED:
    register_callback(_name, getattr(lightnings, _name))
for _kind in (WeightAveraging, EMAWeightAveraging):
    register_callback(_kind.__name__, _kind)


def unheard(callbacks: Iterable[Callback]) -> list[str]:
    """Return a note for each of a user's callbacks with test hooks, which the final test does not call.

    The test split is scored without the Trainer.
    """
    hooks = [name for name in vars(Callback) if name.startswith("on_test_")]
    lines = []
    for callback in callbacks:
        kind = type(callback)
        waiting = [name for name in hooks if getattr(kind, name) is not getattr(Callback, name)]
        if waiting and not kind.__module__.startswith("lightning."):
            lines.append(
                f"note: {kind.__name__}: {', '.join(waiting)} never happens: the test split is scored as "
                "`col3d evaluate` scores it"
            )
    return lines
