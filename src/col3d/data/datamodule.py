"""Data sets of a split as batches for Lightning, augmented on the batch's device."""

from collections.abc import Iterator, Mapping
from typing import Any

import torch
from lightning import LightningDataModule
from torch.utils.data import DataLoader, Dataset, DistributedSampler, Sampler

from col3d.batch import Batch
from col3d.checks import DataError
from col3d.data.transforms import Augment, Resize

Frames = Dataset[dict[str, Any]]


class Resized(Dataset[dict[str, Any]]):
    """Another set's items, resized."""

    def __init__(self, frames: Frames, resize: Resize) -> None:
        self.frames, self.resize = frames, resize

    def __len__(self) -> int:
        return len(self.frames)  # type: ignore[arg-type]

    def __getitem__(self, index: int) -> dict[str, Any]:
        return self.resize(self.frames[index])


class EveryFrameOnce(Sampler[int]):
    """Frames rank, rank + world, ... : each is seen by one process, and none twice."""

    def __init__(self, length: int, rank: int, world_size: int) -> None:
        self.indices = range(rank, length, world_size)

    def __len__(self) -> int:
        return len(self.indices)

    def __iter__(self) -> Iterator[int]:
        return iter(self.indices)


class FrameDataModule(LightningDataModule):
    """Loaders over the sets of a split.

    Args:
        frames: sets by split: `train`, `val`, `test`; only those that are used need be there.
        batch_size: frames a step on each device.
        workers: processes that decode.
        augment: draws for training batches, on their device.
        seed: of the order of frames and the draws.
    """

    def __init__(
        self,
        frames: Mapping[str, Frames],
        batch_size: int,
        workers: int = 0,
        augment: Augment | None = None,
        seed: int = 0,
    ) -> None:
        super().__init__()
        self.frames = dict(frames)
        self.batch_size, self.workers, self.augment, self.seed = batch_size, workers, augment, seed

    def lengths(self) -> dict[str, int]:
        """Number of frames by split."""
        return {split: len(frames) for split, frames in self.frames.items()}  # type: ignore[arg-type]

    def train_dataloader(self) -> DataLoader[Any]:
        """Shuffled by (seed, epoch); the last, smaller batch is used too."""
        rank, world_size = self._place()
        self._check_lengths(world_size)
        sampler: Sampler[int] = DistributedSampler(
            self.frames["train"], world_size, rank, shuffle=True, seed=self.seed
        )
        return self._loader("train", sampler)

    def val_dataloader(self) -> DataLoader[Any]:
        """In order, each frame once."""
        return self._evaluation("val")

    def test_dataloader(self) -> DataLoader[Any]:
        """In order, each frame once."""
        return self._evaluation("test")

    def on_after_batch_transfer(self, batch: Batch, dataloader_idx: int) -> Batch:
        """Augment training batches."""
        if self.augment is None or self.trainer is None or not self.trainer.training:
            return batch
        return self.augment(batch, self.seed, self.trainer.current_epoch)

    def _check_lengths(self, world_size: int) -> None:
        for split, length in self.lengths().items():
            if length < world_size:
                raise DataError(
                    f"data.split.{split}: {length} frames are fewer than {world_size} processes; "
                    "take more frames or fewer trainer.devices"
                )

    def _evaluation(self, split: str) -> DataLoader[Any]:
        rank, world_size = self._place()
        return self._loader(split, EveryFrameOnce(self.lengths()[split], rank, world_size))

    def _loader(self, split: str, sampler: Sampler[int]) -> DataLoader[Any]:
        return DataLoader(
            self.frames[split],
            batch_size=self.batch_size,
            sampler=sampler,
            num_workers=self.workers,
            persistent_workers=self.workers > 0,
            pin_memory=torch.cuda.is_available(),
        )

    def _place(self) -> tuple[int, int]:
        return (0, 1) if self.trainer is None else (self.trainer.global_rank, self.trainer.world_size)
