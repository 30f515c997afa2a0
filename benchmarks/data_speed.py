"""The data side beside a stand-in for published loaders and a bare copy."""

import argparse
import os
import tempfile
from pathlib import Path

import torch

from benchmarks.frames import READERS, frames_of, prepared, repeated
from benchmarks.loading import Loading
from benchmarks.measure import measured
from benchmarks.report import Row


def data_rows(options: argparse.Namespace, device: torch.device) -> list[Row]:
    """Loading, augmentation, what a frame costs, and memory of workers.

    Raises:
        DataError: a file is not what it should be.
    """
    options.cache.mkdir(parents=True, exist_ok=True)
    parts = frames_of(options.data, options.root, options.cache, tuple(options.full_size), options.frames)
    loading = Loading(tuple(options.size), options.workers, options.batch_size, device)
    before = os.getloadavg()[0]
    with tempfile.TemporaryDirectory(prefix="store-", dir=options.cache) as store:
        videos = prepared(parts, Path(store), loading.size_hw, options.epoch)
        print("measuring for about two minutes; other work on this machine shows in the spreads", flush=True)
        rows = measured(repeated(parts, options.frames), videos, loading, options.repeats)
    print(
        f"{options.data}: an epoch of files is {options.frames} frames, {sum(map(len, parts))} different; "
        f"one of the store {sum(len(video.frames) for video in videos)}; all are in the cache of files. "
        f"{options.repeats} repeats, in each of which all that is compared takes its turn. "
        f"{os.cpu_count()} cores; batches are decoded and augmented on {device.type}. "
        f"Load average {before:.1f} before, {os.getloadavg()[0]:.1f} after."
    )
    return rows


def add_options(made: argparse._ArgumentGroup) -> None:
    """What the data side takes."""
    made.add_argument("--data", choices=["phantom", *READERS], default="phantom", help="phantom is rendered")
    made.add_argument("--root", type=Path, help="folder of the videos of c3vd or c3vdv2")
    made.add_argument("--frames", type=int, default=32, help="frames at full size; an epoch of files")
    made.add_argument("--epoch", type=int, default=400, help="least frames of the store; an epoch of it")
    made.add_argument("--size", type=int, nargs=2, default=(320, 320), help="height and width of samples")
    made.add_argument("--full-size", type=int, nargs=2, default=(1080, 1350), help="of the phantom's frames")
    made.add_argument("--workers", type=int, default=2, help="of every loader")
    made.add_argument("--batch-size", type=int, default=8, help="of every loader")
    made.add_argument("--cache", type=Path, default=Path("data/speed"), help="folder for what is rendered")
