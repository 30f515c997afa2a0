"""Frames at a network's size: from files or several data sets, as codes or in standard units."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor
from torch.utils.data import Dataset

from col3d.data.cache.codes import QuantizedBatch, decode, encode
from col3d.data.datasets.frame_set import FrameSet
from col3d.data.resize import Resize
from col3d.geometry import Camera


class SizedFrames(Dataset[dict[str, Any]], ABC):
    """Frames of one size whose values are those of their codes, from any source.

    Attributes:
        cameras: cameras of the frames, at their size; `QuantizedBatch.lens` is an index of these.
        videos: name of the video of each frame, in order.
        numbers: number of each frame inside its video.
        releases: release of the data set that a video's files follow, by video; empty where there is none.
        dense_truth: see `FrameSet`.
    """

    cameras: tuple[Camera, ...]
    videos: list[str]
    numbers: list[int]
    releases: dict[str, str]
    dense_truth: bool

    @abstractmethod
    def codes(self, indices: Sequence[int]) -> QuantizedBatch:
        """Frames as a batch of codes."""

    def __len__(self) -> int:
        return len(self.videos)

    def __getitem__(self, index: int) -> dict[str, Any]:
        """A frame in standard units: the keys of a `Batch` without its axis b."""
        batch = decode(self.codes([index]), self.cameras)
        return {key: values[0] for key, values in batch.items()}  # type: ignore[index]


class Resized(SizedFrames):
    """A data set's frames, read from its files and resized."""

    def __init__(self, frames: FrameSet, size_hw: tuple[int, int]) -> None:
        self.frames, self.dense_truth = frames, frames.dense_truth
        self.resize = Resize(size_hw, frames.camera)
        self.cameras = (self.resize.resized_camera,)
        self.videos = [frame.video for frame in frames.frames]
        self.numbers = [frame.number for frame in frames.frames]
        self.releases = dict(frames.releases)

    def codes(self, indices: Sequence[int]) -> QuantizedBatch:
        """Frames as a batch of codes."""
        return collated([self.encoded(index) for index in indices])

    def encoded(self, index: int) -> dict[str, Any]:
        """Codes of one frame."""
        item, depth = self.resize.read(self.frames, index), self.frames.max_depth
        about = {"video": item["video"], "frame": item["frame"], "max_depth": depth, "lens": 0}
        return encode(item, depth) | about


class WithTruthOf(Dataset[dict[str, Any]]):
    """A data set's frames, their truth resized in a way of `Resize`; in standard units alone, for scoring."""

    def __init__(self, frames: FrameSet, size_hw: tuple[int, int], truth: str) -> None:
        self.frames, self.resize = frames, Resize(size_hw, frames.camera, truth)
        self.dense_truth = frames.dense_truth

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, index: int) -> dict[str, Any]:
        return self.resize(self.frames[index])


class Joined(SizedFrames):
    """The frames of several data sets one after the other; all have normals, or none has."""

    def __init__(self, parts: Sequence[SizedFrames]) -> None:
        self.parts = tuple(parts)
        self.dense_truth = all(part.dense_truth for part in parts)
        self.cameras = tuple(camera for part in parts for camera in part.cameras)
        self.videos = [video for part in parts for video in part.videos]
        self.numbers = [number for part in parts for number in part.numbers]
        self.releases = {video: release for part in parts for video, release in part.releases.items()}
        self.places = [(n, i) for n, part in enumerate(parts) for i in range(len(part))]

    def codes(self, indices: Sequence[int]) -> QuantizedBatch:
        """Frames as a batch of codes."""
        return collated([self._one(*self.places[index]) for index in indices])

    def _one(self, number: int, index: int) -> dict[str, Any]:
        batch = self.parts[number].codes([index])
        cameras_before = sum(len(part.cameras) for part in self.parts[:number])
        return {key: values[0] for key, values in batch.items()} | {  # type: ignore[index]
            "lens": int(batch["lens"][0]) + cameras_before
        }


def collated(items: Sequence[dict[str, Any]]) -> QuantizedBatch:
    """Collate items into one batch, in shared memory where a worker loads them."""
    batch: dict[str, Any] = {}
    for key in items[0]:
        values = [item[key] for item in items]
        if isinstance(values[0], str):
            batch[key] = values
        elif isinstance(values[0], Tensor) and values[0].ndim:
            batch[key] = torch.stack(values, out=empty((len(values), *values[0].shape), values[0].dtype))
        else:
            batch[key] = torch.tensor([float(v) if key == "max_depth" else int(v) for v in values])
    return batch  # type: ignore[return-value]


def empty(shape: tuple[int, ...], dtype: torch.dtype) -> Tensor:
    """An uninitialised tensor; in a worker of a loader, in memory shared with the parent, to spare a copy."""
    values = torch.empty(shape, dtype=dtype)
    return values.share_memory_() if torch.utils.data.get_worker_info() else values
