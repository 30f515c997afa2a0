"""The same batches in each epoch, for a network to learn by heart."""

from collections.abc import Iterator

from lightning import Callback, LightningModule, Trainer
from torch.utils.data import Sampler


class SameBatches(Callback):
    """Keeps the order of frames that of the first epoch.

    Lightning would leave out the shuffling of a loader's sampler; that of a batch sampler it does not see.
    """

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Before Lightning tells samplers the epoch, and before a frame is read."""
        assert trainer.train_dataloader is not None
        batches = trainer.train_dataloader.batch_sampler
        if not isinstance(batches.sampler, OneOrder):
            batches.sampler = OneOrder(batches.sampler)


class OneOrder(Sampler[int]):
    """The order of a sampler that is told no epoch.

    Args:
        sampler: whose order.
    """

    def __init__(self, sampler: Sampler[int]) -> None:
        self.sampler = sampler

    def __len__(self) -> int:
        return len(self.sampler)  # type: ignore[arg-type]

    def __iter__(self) -> Iterator[int]:
        return iter(self.sampler)
