"""Read prepared frames from a store by memory map."""

import mmap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from col3d.data.cache.codes import ARRAYS, QuantizedBatch
from col3d.data.cache.index import SPARSE_RULE, Shard, StoredVideo
from col3d.data.sized import SizedFrames, empty
from col3d.geometry import Camera

RELEASE_BYTES = 64 << 20
"""Bytes read after which pages of maps are given back: until then they count as memory of the process.

Giving them back does not evict them from the page cache."""


class Stored(SizedFrames):
    """Frames of stored videos. Memory maps are opened at the first read, and are never pickled.

    Args:
        videos: stored videos, each with the numbers of its requested frames.

    Raises:
        DataError: an array is not whole.
    """

    def __init__(self, videos: Sequence[tuple[StoredVideo, Sequence[int]]]) -> None:
        self.stored = [video for video, _ in videos]
        for video in self.stored:
            video.check()
        self.cameras: tuple[Camera, ...] = (self.stored[0].camera,)
        self.videos = [video.video for video, numbers in videos for _ in numbers]
        self.numbers = [number for _, numbers in videos for number in numbers]
        self.releases = {video.video: video.release for video in self.stored}
        self.dense_truth = all(video.recipe["resize"] != SPARSE_RULE for video in self.stored)
        rows = [{number: row for row, number in enumerate(video.frames)} for video in self.stored]
        self.places = [(n, rows[n][number]) for n, (_, numbers) in enumerate(videos) for number in numbers]
        self.maps: dict[tuple[int, str], _Map] = {}
        self.bytes_read = 0

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "maps": {}}

    def codes(self, indices: Sequence[int]) -> QuantizedBatch:
        """Frames as a batch of codes."""
        places = [self.places[index] for index in indices]
        first, count = self.stored[0], len(indices)
        batch: dict[str, Any] = {}
        for name, shard in first.shards.items():
            into = empty((count, *shard.shape[1:]), ARRAYS[name][2])
            bits = into.numpy().view(shard.dtype)
            for row, (video, frame) in enumerate(places):
                bits[row] = self._map(video, name).values[frame]
            batch[name] = into
            self.bytes_read += into.nbytes
        self._give_pages_back()
        numbers = [self.stored[video].frames[row] for video, row in places]
        depth = [float(self.stored[video].recipe["max_depth"]) for video, _ in places]
        return batch | {  # type: ignore[return-value]
            "max_depth": torch.tensor(depth),
            "lens": torch.zeros(count, dtype=torch.int64),
            "video": [self.stored[video].video for video, _ in places],
            "frame": torch.tensor(numbers),
        }

    def _map(self, video: int, name: str) -> "_Map":
        key = (video, name)
        if key not in self.maps:
            stored = self.stored[video]
            self.maps[key] = _Map(stored.folder / f"{name}.npy", stored.shards[name])
        return self.maps[key]

    def _give_pages_back(self) -> None:
        if self.bytes_read > RELEASE_BYTES:
            self.bytes_read = 0
            for opened in self.maps.values():
                opened.give_pages_back()


class _Map:
    """A memory map of one array, checked once more, for it may have changed since the store was opened."""

    def __init__(self, path: Path, shard: Shard) -> None:
        shard.check(path)
        with path.open("rb") as file:
            self.pages = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        self.values = np.ndarray(shard.shape, shard.dtype, self.pages, shard.offset)

    def give_pages_back(self) -> None:
        self.pages.madvise(mmap.MADV_DONTNEED)
