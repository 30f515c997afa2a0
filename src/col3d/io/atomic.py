"""Files that are there whole or as they were before."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

PARTIAL = ".partial"
"""What the name of a file ends in while it is written."""
BUFFER = 1 << 22
"""Bytes read or written at once: an archive of torch is hundreds of pieces, each else a trip to a server."""


@contextmanager
def whole_file(path: Path, writer: str = "") -> Iterator[BinaryIO]:
    """A file beside `path` to write into, which takes its place once it is on the disk.

    Args:
        path: of the file.
        writer: tells apart processes that may write it at the same time.

    Raises:
        OSError: names `path`; what was there before is there still, and nothing beside it.
    """
    partial = path.with_name(f"{path.name}{writer}{PARTIAL}")
    try:
        with partial.open("wb", buffering=BUFFER) as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)
    except BaseException as error:
        with suppress(OSError):
            partial.unlink()
        if isinstance(error, OSError) and error.filename in (None, str(partial)):
            error.filename = str(path)  # a disk that is full does not say of what
            error.filename2 = None
        raise


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file in one step.

    Raises:
        OSError: names `path`.
    """
    with whole_file(path) as file:
        file.write(content.encode("utf-8") if isinstance(content, str) else content)
