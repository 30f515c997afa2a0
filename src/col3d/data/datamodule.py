"""Data sets of a split as batches for Lightning, augmented on the batch's device."""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import torch
from lightning import LightningDataModule
from lightning.fabric.utilities import move_data_to_device
from torch.utils.data import BatchSampler, DataLoader, Dataset, DistributedSampler, Sampler

from col3d.batch import Batch
from col3d.data.cache.codes import QuantizedBatch, decode
from col3d.data.sized import SizedFrames
from col3d.data.transforms import Augment
from col3d.data.workers import SteadyLoader
from col3d.errors import DataError
from col3d.geometry import Camera
from col3d.geometry.camera_file import plain_from_camera

Frames = Dataset[dict[str, Any]]


class QuantizedDataset(Dataset[QuantizedBatch]):
    """Frames for a loader: whole batches of codes, which are a third of what they decode to."""

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
    """What `QuantizedDataset` gives needs no collation."""
    return batch


class WeightedOrder(Sampler[int]):
    """Frames of joined data sets in an order of (seed, epoch), each set's `weight` times an epoch on average.

    Args:
        parts: number of frames and weight of each data set.
        seed: of the order.
        rank: of this process; the order is padded with its first frames where it is not divisible.
        world_size: number of processes.
    """

    def __init__(self, parts: Sequence[tuple[int, float]], seed: int, rank: int, world_size: int) -> None:
        self.parts, self.seed, self.rank, self.world_size = parts, seed, rank, world_size
        self.epoch = 0
        self.total = sum(round(count * weight) for count, weight in parts)

    def __len__(self) -> int:
        return math.ceil(self.total / self.world_size)

    def set_epoch(self, epoch: int) -> None:
        """Lightning calls it before each epoch."""
        self.epoch = epoch

    def __iter__(self) -> Iterator[int]:
        generator = torch.Generator().manual_seed(self.seed + self.epoch)
        chosen, offset = [], 0
        for count, weight in self.parts:
            wanted = round(count * weight)
            rounds = [torch.randperm(count, generator=generator) for _ in range(math.ceil(wanted / count))]
            chosen += [order + offset for order in rounds[:-1]]
            chosen += [order[: wanted - count * (len(rounds) - 1)] + offset for order in rounds[-1:]]
            offset += count
        order = torch.cat(chosen)[torch.randperm(self.total, generator=generator)]
        order = torch.cat([order, order[: len(self) * self.world_size - self.total]])
        return iter(order[self.rank :: self.world_size].tolist())


class ShardedSampler(Sampler[int]):
    """Frames rank, rank + world, ... : each is seen by one process, and none twice."""

    def __init__(self, length: int, rank: int, world_size: int) -> None:
        self.indices = range(rank, length, world_size)

    def __len__(self) -> int:
        return len(self.indices)

    def __iter__(self) -> Iterator[int]:
        return iter(self.indices)


class ResumableLoader(SteadyLoader):
    """A loader whose position a checkpoint keeps: the epoch that follows `load_state_dict` begins there.

    The order of frames is one of (seed, epoch): the number of batches is all there is to keep.
    """

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._given, self._passed_over = 0, 0

    def __iter__(self) -> Iterator[Any]:  # type: ignore[override]
        self._given, self._passed_over = self._passed_over, 0
        return self._from(self._given)

    def _from(self, start: int) -> Iterator[Any]:
        """Nothing is read before the first batch is asked for: only then has Lightning told the epoch."""
        self.batch_sampler.start = start  # type: ignore[union-attr]
        for batch in super().__iter__():
            self._given += 1
            yield batch

    def state_dict(self) -> dict[str, int]:
        """How many batches of the epoch it has given."""
        return {"batches": self._given}

    def load_state_dict(self, state: Mapping[str, int]) -> None:
        """Pass over as many in the next epoch."""
        self._passed_over = state["batches"]


class LaterBatches(BatchSampler):
    """Batches of an order of frames, from the `start`-th on."""

    start = 0

    def __iter__(self) -> Iterator[list[int]]:
        return itertools.islice(super().__iter__(), self.start, None)


class FrameDataModule(LightningDataModule):
    """Loaders over the sets of a split.

    Frames of a known size are decoded on the device of the batch, whatever worker loaded their codes.

    Args:
        frames: sets by split: `train`, `val`, `test`; only those that are used need be there.
        batch_size: frames a step on each device.
        workers: processes that decode.
        augment: draws for training batches, on their device.
        seed: of the order of frames and the draws.
        weights: of data sets that are joined for training: their frames, and how often an epoch shows each.
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
        """Shuffled by (seed, epoch); the last, smaller batch is used too."""
        rank, world_size = self._place()
        self._check_lengths(world_size)
        frames = self.frames["train"]
        sampler: Sampler[int] = DistributedSampler(frames, world_size, rank, shuffle=True, seed=self.seed)
        if len(self.weights) > 1 or any(weight != 1 for _, weight in self.weights):
            sampler = WeightedOrder(self.weights, self.seed, rank, world_size)
        self._train_loader = self._loader("train", sampler)
        self._train_loader.load_state_dict(self._position)
        return self._train_loader

    def state_dict(self) -> dict[str, Any]:
        """The place in the epoch, for checkpoints: 0 when the epoch has seen all its batches."""
        if self._train_loader is None:
            return self._position
        limit = len(self._train_loader) if self.trainer is None else self.trainer.num_training_batches
        return {"batches": self._train_loader.state_dict()["batches"] % int(limit)}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Go on from there: what loaders keep by themselves is loaded too late, once they iterate."""
        self._position = state_dict

    def val_dataloader(self) -> DataLoader[Any]:
        """In order, each frame once."""
        return self._evaluation("val")

    def test_dataloader(self) -> DataLoader[Any]:
        """In order, each frame once."""
        return self._evaluation("test")

    def on_after_batch_transfer(self, batch: Any, dataloader_idx: int) -> Batch:
        """Decode, and augment training batches."""
        standard = self._decoded(batch)
        if self.augment is None or self.trainer is None or not self.trainer.training:
            return standard
        return self.augment(standard, self.seed, self.trainer.current_epoch)

    def frames_in_order(
        self, split: str, device: torch.device, limit: int | float | None = None
    ) -> Iterator[Batch]:
        """The frames of a part on a device, each once; of the processes of a training each has its own.

        Args:
            split: the part.
            device: where batches go.
            limit: of batches: their number, or a share below 1.
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
        rank, world_size = self._place()
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

    def _place(self) -> tuple[int, int]:
        if self.trainer is not None:
            return self.trainer.global_rank, self.trainer.world_size
        if torch.distributed.is_initialized():
            return torch.distributed.get_rank(), torch.distributed.get_world_size()
        return 0, 1
