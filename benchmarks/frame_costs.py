"""What a frame of files costs one core, by part."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial

import numpy as np
import torch

from benchmarks.published_loader import PublishedLoader
from benchmarks.timing import interleaved
from col3d.data.datasets.frame_set import FrameSet
from col3d.data.files.image_files import read_grey, read_rgb
from col3d.data.sized import Resized

FRAMES = 8
WHOLE, STAND_IN = "raw, the whole frame", "stand-in, the whole frame"
REST = "raw, the rest: resize, standard units, codes"


def frame_costs(frames: FrameSet, size_hw: tuple[int, int], repeats: int) -> dict[str, list[float]]:
    """Milliseconds of one core for each part of a frame, for each repeat."""
    size = frames.camera.size_hw
    files = [frame.files for frame in frames.frames[:FRAMES]]
    parts: dict[str, Callable[[int], object]] = {
        "raw, colour PNG decoded": lambda index: read_rgb(files[index]["color"], size, np.uint8),
        "raw, depth TIFF decoded": lambda index: read_grey(files[index]["depth"], size, np.uint16),
        "raw, normals TIFF decoded": lambda index: read_rgb(files[index]["normals"], size, np.uint16),
        WHOLE: Resized(frames, size_hw).encoded,
        STAND_IN: PublishedLoader(frames, size_hw).__getitem__,
    }
    with _one_thread():
        seconds = interleaved({n: partial(_each, part, len(files)) for n, part in parts.items()}, repeats)
    costs = {name: [1000 * second / len(files) for second in taken] for name, taken in seconds.items()}
    whole, stand_in = costs.pop(WHOLE), costs.pop(STAND_IN)
    decoded = [sum(part) for part in zip(*costs.values(), strict=True)]
    rest = [all_of_it - part for all_of_it, part in zip(whole, decoded, strict=True)]
    return costs | {REST: rest, WHOLE: whole, STAND_IN: stand_in}


def _each(part: Callable[[int], object], count: int) -> None:
    for index in range(count):
        part(index)


@contextmanager
def _one_thread() -> Iterator[None]:
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
