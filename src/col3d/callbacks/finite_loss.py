"""Stops a training whose loss is not a finite number, before it spoils weights and checkpoints."""

from typing import Any

import torch
from lightning import Callback, LightningModule, Trainer
from torch import Tensor


class DivergedError(RuntimeError):
    """The loss became NaN or infinite."""


class FiniteLoss(Callback):
    """Checks the loss of every step before the optimiser uses it."""

    def __init__(self) -> None:
        self.frames = ""

    def on_train_batch_start(
        self, trainer: Trainer, pl_module: LightningModule, batch: Any, batch_idx: int
    ) -> None:
        """Remember which frames the step is about."""
        pairs = zip(batch["video"], batch["frame"].tolist(), strict=True)
        self.frames = ", ".join(f"{video}:{frame}" for video, frame in pairs)

    def on_before_backward(self, trainer: Trainer, pl_module: LightningModule, loss: Tensor) -> None:
        """Refuse a loss that is not finite.

        Raises:
            DivergedError: names step and frames.
        """
        if not torch.isfinite(loss):
            step = trainer.fit_loop.total_batch_idx
            raise DivergedError(
                f"the loss is {loss.item()} at step {step} (frames {self.frames}); "
                "lower optimizer.lr, set trainer.gradient_clip, or look at these frames"
            )
