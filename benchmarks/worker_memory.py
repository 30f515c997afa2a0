"""Memory of a loader's worker while it reads a store that is larger than it may grow."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torch.utils.data import DataLoader, Dataset

from col3d.data.cache import Stored, StoredVideo
from col3d.data.datamodule import QuantizedDataset, identity_collate

STATUS = Path("/proc/self/status")
KEPT, MOST = "VmRSS", "VmHWM"
PARTS = 10


@dataclass(frozen=True)
class Memory:
    """MB of a worker over an epoch.

    Attributes:
        read: of the store.
        tenths: in memory after each tenth of the epoch.
        largest: that it ever had.
    """

    read: float
    tenths: tuple[float, ...]
    largest: float

    @property
    def growth(self) -> float:
        """From the first tenth to the largest."""
        return self.largest - self.tenths[0]


class Weighed(Dataset[dict[str, Any]]):
    """Batches of codes, each with the memory of the process that loaded it."""

    def __init__(self, stored: Stored) -> None:
        self.coded = QuantizedDataset(stored, stored.cameras)

    def __len__(self) -> int:
        return len(self.coded)

    def __getitems__(self, indices: Sequence[int]) -> dict[str, Any]:
        """Frames as one batch."""
        return {"codes": self.coded.__getitems__(indices), **own_memory()}


def own_memory() -> dict[str, float]:
    """MB that this process has in memory, files that it maps included, and the most that it ever had."""
    lines = dict(line.split(":", 1) for line in STATUS.read_text(encoding="utf-8").splitlines())
    return {name: int(lines[name].split()[0]) / 1024 for name in (KEPT, MOST)}


def worker_memory(videos: Sequence[StoredVideo], batch_size: int) -> Memory | None:
    """Of the only worker of a loader; None where there is no /proc to tell it."""
    if not STATUS.is_file():
        return None
    stored = Stored([(video, video.frames) for video in videos])
    loader = DataLoader(Weighed(stored), batch_size, shuffle=True, num_workers=1, collate_fn=identity_collate)
    seen = [(batch[KEPT], batch[MOST]) for batch in loader]
    ends = [max(1, len(seen) * part // PARTS) - 1 for part in range(1, PARTS + 1)]
    read = sum(shard.bytes for video in videos for shard in video.shards.values())
    return Memory(read / 2**20, tuple(seen[end][0] for end in ends), seen[-1][1])
