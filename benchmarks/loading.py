"""Samples a second: from a store, from the files, from a stand-in for published loaders, by copying."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import torch
from torch import Tensor
from torch.utils.data import DataLoader, Dataset

from benchmarks.bare_copy import BareCopy
from benchmarks.published_loader import PublishedLoader
from benchmarks.timing import Work, interleaved, rates
from col3d.batch import Batch
from col3d.data.cache import Stored, StoredVideo
from col3d.data.cache.codes import QuantizedBatch, decode
from col3d.data.datamodule import FrameDataModule, identity_collate
from col3d.data.datasets.frame_set import FrameSet
from col3d.data.sized import Resized, SizedFrames


@dataclass(frozen=True)
class Loading:
    """Frames are loaded at this size by so many workers, in such batches, and decoded on the device."""

    size_hw: tuple[int, int]
    workers: int
    batch_size: int
    device: torch.device


def loading_speeds(
    frames: FrameSet, videos: Sequence[StoredVideo], loading: Loading, repeats: int
) -> dict[str, list[float]]:
    """Samples a second from each source in each repeat, an epoch of every source after the other.

    Args:
        frames: at full size.
        videos: of the store.
        loading: how.
        repeats: that are counted.
    """
    resized, stand_in = Resized(frames, loading.size_hw), PublishedLoader(frames, loading.size_hw)
    stored = Stored([(video, video.frames) for video in videos])
    bare = BareCopy([(video.folder, len(video.frames)) for video in videos])
    from_store, from_files = (our_loader(part, loading) for part in (stored, resized))
    epochs: dict[str, tuple[int, Work]] = {
        "store": (len(stored), partial(_load, from_store)),
        "store, decoded": (len(stored), partial(_decode, from_store, stored, loading.device)),
        "raw": (len(resized), partial(_load, from_files)),
        "raw, decoded": (len(resized), partial(_decode, from_files, resized, loading.device)),
        "stand-in": (len(stand_in), partial(_load, _plain_loader(stand_in, loading))),
        "copy": (len(bare), partial(_load, _plain_loader(bare, loading, identity_collate))),
        "copy, no loader": (len(bare), partial(_copy_here, bare)),
    }
    seconds = interleaved({name: epoch for name, (_, epoch) in epochs.items()}, repeats)
    return {name: rates(epochs[name][0], taken) for name, taken in seconds.items()}


def our_loader(frames: SizedFrames, loading: Loading) -> DataLoader[Any]:
    """The loader of training batches, as a training has it."""
    return FrameDataModule({"train": frames}, loading.batch_size, loading.workers).train_dataloader()


def on_device(codes: QuantizedBatch, device: torch.device) -> QuantizedBatch:
    """Codes where they are decoded."""
    tensors = {key: value for key, value in codes.items() if isinstance(value, Tensor)}
    return codes | {key: value.to(device, non_blocking=True) for key, value in tensors.items()}  # type: ignore[return-value]


def our_batch(frames: SizedFrames, batch_size: int, device: torch.device) -> Batch:
    """The first frames in standard units on a device."""
    indices = [index % len(frames) for index in range(batch_size)]
    return decode(on_device(frames.codes(indices), device), frames.cameras)


def wait_for(device: torch.device) -> None:
    """Until a device has done what it was told."""
    if device.type == "cuda":
        torch.cuda.synchronize(device)


def _plain_loader(frames: Dataset[Any], loading: Loading, collate: Any = None) -> DataLoader[Any]:
    return DataLoader(
        frames,
        loading.batch_size,
        shuffle=True,
        num_workers=loading.workers,
        persistent_workers=loading.workers > 0,
        collate_fn=collate,
        pin_memory=torch.cuda.is_available(),
    )


def _load(loader: DataLoader[Any]) -> None:
    for _ in loader:
        pass


def _decode(loader: DataLoader[Any], frames: SizedFrames, device: torch.device) -> None:
    for codes in loader:
        decode(on_device(codes, device), frames.cameras)
    wait_for(device)


def _copy_here(bare: BareCopy) -> None:
    for index in torch.randperm(len(bare)).tolist():
        bare[index]
