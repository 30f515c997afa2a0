"""Atomic writing of files: after a failure the previous content is still there."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

PARTIAL = ".partial"
"""Suffix of a file's name while it is being written."""
BUFFER = 1 << 22
"""Bytes read or written at once: torch writes an archive in hundreds of pieces, each of which
would be a round trip to a file server."""


@contextmanager
def whole_file(path: Path, writer: str = "") -> Iterator[BinaryIO]:
    """Open a temporary file beside `path`, which replaces `path` once it is on the disk.

    Args:
        path: path of the file.
        writer: suffix that distinguishes processes which may write the file at the same time.

    Raises:
        OSError: names `path`; the previous file is unchanged and the temporary one is removed.
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
            error.filename = str(path)  # the error of a full disk names no file
            error.filename2 = None
        raise


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file atomically.

    Raises:
        OSError: names `path`.
    """
    with whole_file(path) as file:
        file.write(content.encode("utf-8") if isinstance(content, str) else content)
