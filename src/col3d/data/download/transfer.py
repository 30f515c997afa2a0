"""Fetch one file, resuming where the last attempt ended, and verify its checksum."""

import hashlib
import re
from collections.abc import Callable
from http import HTTPStatus
from pathlib import Path
from threading import Event

from col3d.data.download.listing import RemoteFile
from col3d.data.download.server import DROPPED, BusyError, Interrupted, Server, ServerError
from col3d.errors import naming
from col3d.io.atomic import PARTIAL

CHUNK = 1 << 20
WHOLE_TRIES = 2
"""How many times a file with a wrong checksum is fetched."""


def fetch(
    server: Server, file: RemoteFile, path: Path, progress: Callable[[int], None] = lambda done: None
) -> None:
    """Fetch a file to `path`, by way of `path.partial`, which is kept on errors and resumed.

    Args:
        server: the server of the file.
        file: file to fetch.
        path: path to write to.
        progress: called repeatedly with the number of bytes on the disk.

    Raises:
        ServerError: it could not be fetched, or its checksum is wrong.
        Interrupted: the server's `stop` was set.
        OSError: it cannot be written.
    """
    partial = path.with_name(path.name + PARTIAL)
    for left in reversed(range(WHOLE_TRIES)):
        before = [_size(partial)]

        def attempt(before: list[int] = before) -> None:
            before[0] = _size(partial)
            _go_on(server, file, partial, progress)

        server.again(attempt, lambda before=before: _size(partial) > before[0])  # type: ignore[misc]
        wrong = mismatch(file, partial, server.stop)
        if wrong is None:
            with naming(path):
                partial.replace(path)
            return
        with naming(partial):
            partial.unlink()
        if not left:
            raise ServerError(f"{file.name}: {wrong}; fetched {WHOLE_TRIES} times")


def mismatch(file: RemoteFile, path: Path, stop: Event) -> str | None:
    """How a file on the disk differs from the server's description; None where it does not.

    Raises:
        Interrupted: `stop` was set.
        OSError: it cannot be read.
    """
    if (size := path.stat().st_size) != file.size:
        return f"{size} bytes instead of {file.size}"
    if not file.hashed_by:
        return None
    digest = hashlib.new(file.hashed_by, usedforsecurity=False)
    with path.open("rb") as content:
        while chunk := content.read(CHUNK):
            if stop.is_set():
                raise Interrupted
            digest.update(chunk)
    if (actual := digest.hexdigest()) != file.checksum:
        return f"its {file.hashed_by} is {actual}, and the server says {file.checksum}"
    return None


def _go_on(server: Server, file: RemoteFile, partial: Path, progress: Callable[[int], None]) -> None:
    """Request the missing bytes and append them.

    Raises:
        BusyError: the connection broke before the end.
    """
    done = _size(partial)
    if done > file.size:
        partial.unlink()
        done = 0
    progress(done)
    if done == file.size and partial.exists():
        return
    headers = {"Range": f"bytes={done}-"} if done else {}
    with server.open(file.path, headers) as answer:
        done = _start(answer.status, answer.headers.get("Content-Range"), done)
        with naming(partial), partial.open("r+b" if partial.exists() else "wb", buffering=0) as content:
            content.truncate(done)
            content.seek(done)
            while chunk := _read(answer, file):
                if server.stop.is_set():
                    raise Interrupted
                done = append(content, chunk, done, file)
                progress(done)
    if done != file.size:
        raise BusyError(f"{file.name}: the connection broke after {done} of {file.size} bytes")


def _start(status: int, span: str | None, done: int) -> int:
    """Offset of the first byte of the answer: servers need not honour a range."""
    if status != HTTPStatus.PARTIAL_CONTENT:
        return 0
    match = re.fullmatch(r"bytes (\d+)-\d+/(?:\d+|\*)", span or "")
    if match is None or int(match[1]) > done:
        raise ServerError(
            f"the server answers with the bytes {span!r} when those from {done} on are asked for"
        )
    return int(match[1])


def _read(answer: object, file: RemoteFile) -> bytes:
    try:
        chunk: bytes = answer.read1(CHUNK)  # type: ignore[attr-defined]
    except DROPPED as error:
        raise BusyError(f"{file.name}: the connection broke ({error or type(error).__name__})") from None
    return chunk


def append(content: object, chunk: bytes, done: int, file: RemoteFile) -> int:
    """Write all of a chunk; refuse one that exceeds the size of the file."""
    if done + len(chunk) > file.size:
        raise ServerError(f"{file.name}: the server sends more than the {file.size} bytes that it lists")
    left = memoryview(chunk)
    while left:
        left = left[content.write(left) :]  # type: ignore[attr-defined]
    return done + len(chunk)


def _size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0
