"""Callback that freezes an encoder for the first epochs."""

from lightning import Callback, LightningModule, Trainer
from torch import nn


class Unfreeze(Callback):
    """Freezes an encoder until an epoch.

    Its parameters are in the optimiser from the start, so that checkpoints have the same content before and
    after. Under DDP the strategy has to expect parameters without gradients.

    Args:
        encoder: the encoder; parameters that are frozen already stay so.
        epoch: the first epoch, counted from 0, in which it is trained.
    """

    def __init__(self, encoder: nn.Module, epoch: int) -> None:
        self.learning = [parameter for parameter in encoder.parameters() if parameter.requires_grad]
        self.epoch = epoch

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Freeze or unfreeze, because a training may resume within an epoch."""
        self._set(trainer)

    def on_train_epoch_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Freeze or unfreeze the encoder for the epoch."""
        self._set(trainer)

    def _set(self, trainer: Trainer) -> None:
        for parameter in self.learning:
            parameter.requires_grad_(trainer.current_epoch >= self.epoch)
