"""Source files of prepared frames: sizes, modification times and checksums."""

import zlib
from collections.abc import Sequence
from pathlib import Path

from col3d.data.datasets.frame_files import Frame


def state_of(path: Path) -> tuple[int, int]:
    """Size in bytes and modification time in ns of a file."""
    status = path.stat()
    return status.st_size, status.st_mtime_ns


def sources_of(root: Path, frames: Sequence[Frame]) -> dict[str, tuple[int, int]]:
    """State of every file that frames are read from."""
    paths = [path for frame in frames for path in frame.files.values()]
    return {path.relative_to(root).as_posix(): state_of(path) for path in paths}


def crc32_of(path: Path) -> int:
    """CRC-32 of a whole file."""
    checksum = 0
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            checksum = zlib.crc32(block, checksum)
    return checksum
