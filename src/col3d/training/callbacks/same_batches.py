"""Callback that repeats the same batches in each epoch, to overfit a network to them."""

from collections.abc import Iterator

from lightning import Callback, LightningModule, Trainer
from torch.utils.data import Sampler


class SameBatches(Callback):
    """Keeps the order of frames of the first epoch in all epochs.

    Lightning disables the shuffling of a loader's sampler, but not that of a batch sampler.
    """

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Replace the sampler, before Lightning sets its epoch and before a frame is read."""
        assert trainer.train_dataloader is not None
        batches = trainer.train_dataloader.batch_sampler
        if not isinstance(batches.sampler, OneOrder):
            batches.sampler = OneOrder(batches.sampler)


class OneOrder(Sampler[int]):
    """Wraps a sampler without `set_epoch`, so that its order stays the same.

    Args:
        sampler: the sampler.
    """

    def __init__(self, sampler: Sampler[int]) -> None:
        self.sampler = sampler

    def __len__(self) -> int:
        return len(self.sampler)  # type: ignore[arg-type]

    def __iter__(self) -> Iterator[int]:
        return iter(self.sampler)
