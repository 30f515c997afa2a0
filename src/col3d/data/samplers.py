"""Orders of frames, and a loader that can resume in the middle of an epoch."""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import torch
from torch.utils.data import BatchSampler, Sampler

from col3d.data.workers import SteadyLoader


class WeightedOrder(Sampler[int]):
    """Frames of joined data sets in an order of (seed, epoch), each set's `weight` times an epoch on average.

    Args:
        parts: number of frames and weight of each data set.
        seed: seed of the order.
        rank: rank of this process; the order is padded with its first frames where it is not divisible.
        world_size: number of processes.
    """

    def __init__(self, parts: Sequence[tuple[int, float]], seed: int, rank: int, world_size: int) -> None:
        self.parts, self.seed, self.rank, self.world_size = parts, seed, rank, world_size
        self.epoch = 0
        self.total = sum(round(count * weight) for count, weight in parts)

    def __len__(self) -> int:
        return math.ceil(self.total / self.world_size)

    def set_epoch(self, epoch: int) -> None:
        """Set the epoch of the order; Lightning calls it before each epoch."""
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
    """A loader whose position checkpoints keep: the epoch after `load_state_dict` begins there.

    The order of frames depends on (seed, epoch) alone, so that the number of batches is all there is to keep.
    """

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._given, self._passed_over = 0, 0

    def __iter__(self) -> Iterator[Any]:  # type: ignore[override]
        self._given, self._passed_over = self._passed_over, 0
        return self._from(self._given)

    def _from(self, start: int) -> Iterator[Any]:
        """Read nothing before the first batch is requested: only then has Lightning set the epoch."""
        self.batch_sampler.start = start  # type: ignore[union-attr]
        for batch in super().__iter__():
            self._given += 1
            yield batch

    def state_dict(self) -> dict[str, int]:
        """Number of batches of the epoch that were given."""
        return {"batches": self._given}

    def load_state_dict(self, state: Mapping[str, int]) -> None:
        """Skip as many batches in the next epoch."""
        self._passed_over = state["batches"]


class LaterBatches(BatchSampler):
    """Batches of an order of frames, from the `start`-th on."""

    start = 0

    def __iter__(self) -> Iterator[list[int]]:
        return itertools.islice(super().__iter__(), self.start, None)
