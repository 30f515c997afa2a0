"""The files that prepared frames were made of, and whether they are still the same."""

import zlib
from collections.abc import Sequence
from pathlib import Path

from col3d.data.datasets.frame_files import Frame


def state_of(path: Path) -> tuple[int, int]:
    """Bytes and time of change of a source."""
    found = path.stat()
    return found.st_size, found.st_mtime_ns


def sources_of(root: Path, frames: Sequence[Frame]) -> dict[str, tuple[int, int]]:
    """State of every file that frames are read from."""
    paths = [path for frame in frames for path in frame.files.values()]
    return {path.relative_to(root).as_posix(): state_of(path) for path in paths}


def crc32_of(path: Path) -> int:
    """Of a whole file."""
    found = 0
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            found = zlib.crc32(block, found)
    return found
