"""An encoder that is kept for some epochs, and then learns."""

from lightning import Callback, LightningModule, Trainer
from torch import nn


class Unfreeze(Callback):
    """Keeps an encoder as it is until an epoch.

    Its parameters are in the optimiser from the start: what a checkpoint holds is the same before and after.
    Under DDP the strategy has to expect parameters without gradients.

    Args:
        encoder: what is kept; parts of it that never learn stay so.
        epoch: from which on it learns, the first being 0.
    """

    def __init__(self, encoder: nn.Module, epoch: int) -> None:
        self.learning = [parameter for parameter in encoder.parameters() if parameter.requires_grad]
        self.epoch = epoch

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """A training may go on within an epoch."""
        self._set(trainer)

    def on_train_epoch_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Keep it, or let it learn."""
        self._set(trainer)

    def _set(self, trainer: Trainer) -> None:
        for parameter in self.learning:
            parameter.requires_grad_(trainer.current_epoch >= self.epoch)
