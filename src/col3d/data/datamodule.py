"""Data sets of a split as batches for Lightning, augmented on the batch's device."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import torch
from lightning import LightningDataModule
from lightning.fabric.utilities import move_data_to_device
from torch.utils.data import DataLoader, Dataset, DistributedSampler, Sampler

from col3d.batch import Batch
from col3d.data.cache.codes import QuantizedBatch, decode
from col3d.data.samplers import LaterBatches, ResumableLoader, ShardedSampler, WeightedOrder
from col3d.data.sized import SizedFrames
from col3d.data.transforms import Augment, draws_of
from col3d.errors import DataError
from col3d.geometry import Camera
from col3d.geometry.camera_file import plain_from_camera

Frames = Dataset[dict[str, Any]]
DRAWS = "draws"
"""Of a training batch, from the host to its device."""


class QuantizedDataset(Dataset[QuantizedBatch]):
    """Frames for a loader: whole batches of codes, which are a third of the size of decoded ones."""

    def __init__(self, frames: SizedFrames, cameras: Sequence[Camera]) -> None:
        self.frames = frames
        self.lenses = torch.tensor([cameras.index(camera) for camera in frames.cameras])

    def __len__(self) -> int:
        return len(self.frames)

    def __getitems__(self, indices: Sequence[int]) -> QuantizedBatch:
        """Frames as one batch."""
        codes = self.frames.codes(indices)
        return codes | {"lens": self.lenses[codes["lens"]]}


def identity_collate(batch: Any) -> Any:
    """Return the batch: `QuantizedDataset` makes whole batches, which need no collation."""
    return batch


class FrameDataModule(LightningDataModule):
    """Loaders over the sets of a split.

    Frames of a known size are decoded on the device of the batch, whatever worker loaded their codes.

    Args:
        frames: sets by split: `train`, `val`, `test`; only those that are used are needed.
        batch_size: frames a step on each device.
        workers: number of processes that load frames.
        augment: random transforms of training batches, on their device.
        seed: seed of the order of frames and of the transforms.
        weights: for each data set that is joined for training, its number of frames, and how often an epoch
            shows each.
    """

    def __init__(
        self,
        frames: Mapping[str, Frames],
        batch_size: int,
        workers: int = 0,
        augment: Augment | None = None,
        seed: int = 0,
        weights: Sequence[tuple[int, float]] = (),
    ) -> None:
        super().__init__()
        self.frames = dict(frames)
        self.batch_size, self.workers, self.augment, self.seed = batch_size, workers, augment, seed
        self.weights = list(weights)
        self._train_loader: ResumableLoader | None = None
        self._position: dict[str, int] = {"batches": 0}
        sized = [part for part in frames.values() if isinstance(part, SizedFrames)]
        self.cameras = list(dict.fromkeys(camera for part in sized for camera in part.cameras))

    def lengths(self) -> dict[str, int]:
        """Number of frames by split."""
        return {split: len(frames) for split, frames in self.frames.items()}  # type: ignore[arg-type]

    def about(self) -> dict[str, Any]:
        """Releases, lenses and numbers of frames, as plain values."""
        sized = [part for part in self.frames.values() if isinstance(part, SizedFrames)]
        releases = {video: release for part in sized for video, release in part.releases.items()}
        return {
            "release": releases,
            "cameras": [plain_from_camera(camera) for camera in self.cameras],
            "frames": self.lengths(),
        }

    def train_dataloader(self) -> DataLoader[Any]:
        """Loader of training frames, shuffled by (seed, epoch); the last, smaller batch is used too."""
        rank, world_size = self.place()
        self._check_lengths(world_size)
        frames = self.frames["train"]
        sampler: Sampler[int] = DistributedSampler(frames, world_size, rank, shuffle=True, seed=self.seed)
        if len(self.weights) > 1 or any(weight != 1 for _, weight in self.weights):
            sampler = WeightedOrder(self.weights, self.seed, rank, world_size)
        self._train_loader = self._loader("train", sampler)
        self._train_loader.load_state_dict(self._position)
        return self._train_loader

    def state_dict(self) -> dict[str, Any]:
        """Position in the epoch, for checkpoints: 0 when the epoch has seen all its batches."""
        if self._train_loader is None:
            return self._position
        limit = len(self._train_loader) if self.trainer is None else self.trainer.num_training_batches
        return {"batches": self._train_loader.state_dict()["batches"] % int(limit)}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Resume at a position: loaders' own states are loaded too late, once they iterate."""
        self._position = state_dict

    def val_dataloader(self) -> DataLoader[Any]:
        """Loader of validation frames in order, each frame once."""
        return self._evaluation("val")

    def test_dataloader(self) -> DataLoader[Any]:
        """Loader of test frames in order, each frame once."""
        return self._evaluation("test")

    def on_before_batch_transfer(self, batch: Any, dataloader_idx: int) -> Any:
        """Draw for training batches, from numbers of frames that are not yet on the device."""
        if self.augment is None or self.trainer is None or not self.trainer.training:
            return batch
        return {**batch, DRAWS: draws_of(batch, self.seed, self.trainer.current_epoch)}

    def on_after_batch_transfer(self, batch: Any, dataloader_idx: int) -> Batch:
        """Decode batches, and augment training batches."""
        draws = batch.pop(DRAWS, None)
        standard = self._decoded(batch)
        return standard if draws is None or self.augment is None else self.augment(standard, draws)

    def frames_in_order(
        self, split: str, device: torch.device, limit: int | float | None = None
    ) -> Iterator[Batch]:
        """Yield the frames of a part on a device, each once; each process of a training has its own share.

        Args:
            split: the part.
            device: where batches go.
            limit: largest number of batches, or a share of them as a float.
        """
        loader = self._evaluation(split)
        most = max(1, int(len(loader) * limit)) if isinstance(limit, float) else limit
        for batch in itertools.islice(loader, most):
            yield self._decoded(move_data_to_device(batch, device))

    def _decoded(self, batch: Any) -> Batch:
        decoded: Batch = decode(batch, self.cameras) if "lens" in batch else batch
        return decoded

    def _check_lengths(self, world_size: int) -> None:
        for split, length in self.lengths().items():
            if length < world_size:
                raise DataError(
                    f"data.split.{split}: {length} frames are fewer than {world_size} processes; "
                    "take more frames or fewer trainer.devices"
                )

    def _evaluation(self, split: str) -> DataLoader[Any]:
        rank, world_size = self.place()
        return self._loader(split, ShardedSampler(self.lengths()[split], rank, world_size))

    def _loader(self, split: str, sampler: Sampler[int]) -> ResumableLoader:
        frames = self.frames[split]
        coded = QuantizedDataset(frames, self.cameras) if isinstance(frames, SizedFrames) else None
        return ResumableLoader(
            frames if coded is None else coded,
            batch_sampler=LaterBatches(sampler, self.batch_size, drop_last=False),
            collate_fn=None if coded is None else identity_collate,
            num_workers=self.workers,
            persistent_workers=self.workers > 0,
            pin_memory=torch.cuda.is_available(),
        )

    def place(self) -> tuple[int, int]:
        """Rank of this process among those of one training, and how many there are."""
        if self.trainer is not None:
            return self.trainer.global_rank, self.trainer.world_size
        if torch.distributed.is_initialized():
            return torch.distributed.get_rank(), torch.distributed.get_world_size()
        return 0, 1
