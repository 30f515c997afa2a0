"""One file from a server onto the disk, whole and as its checksum says, from where the last attempt ended."""

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
"""How often a file is fetched whose checksum is wrong."""


def fetch(
    server: Server, file: RemoteFile, path: Path, told: Callable[[int], None] = lambda done: None
) -> None:
    """Bring a file to `path`, over `path.partial`, which stays where something breaks and is gone on with.

    Args:
        server: that has it.
        file: which.
        path: where it is to be.
        told: is called with the bytes that are there, again and again.

    Raises:
        ServerError: it was not to be had, or is another than its checksum says.
        Interrupted: the server's `stop` was set.
        OSError: it cannot be written.
    """
    partial = path.with_name(path.name + PARTIAL)
    for left in reversed(range(WHOLE_TRIES)):
        before = [_size(partial)]

        def attempt(before: list[int] = before) -> None:
            before[0] = _size(partial)
            _go_on(server, file, partial, told)

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
    """How a file on the disk differs from the one that the server describes; None where it does not.

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
    if (found := digest.hexdigest()) != file.checksum:
        return f"its {file.hashed_by} is {found}, and the server says {file.checksum}"
    return None


def _go_on(server: Server, file: RemoteFile, partial: Path, told: Callable[[int], None]) -> None:
    """Ask for what is missing and append it.

    Raises:
        BusyError: the connection broke before the end.
    """
    done = _size(partial)
    if done > file.size:
        partial.unlink()
        done = 0
    told(done)
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
                told(done)
    if done != file.size:
        raise BusyError(f"{file.name}: the connection broke after {done} of {file.size} bytes")


def _start(status: int, span: str | None, done: int) -> int:
    """From which byte on the answer is; servers need not heed a range."""
    if status != HTTPStatus.PARTIAL_CONTENT:
        return 0
    found = re.fullmatch(r"bytes (\d+)-\d+/(?:\d+|\*)", span or "")
    if found is None or int(found[1]) > done:
        raise ServerError(
            f"the server answers with the bytes {span!r} when those from {done} on are asked for"
        )
    return int(found[1])


def _read(answer: object, file: RemoteFile) -> bytes:
    try:
        chunk: bytes = answer.read1(CHUNK)  # type: ignore[attr-defined]
    except DROPPED as error:
        raise BusyError(f"{file.name}: the connection broke ({error or type(error).__name__})") from None
    return chunk


def append(content: object, chunk: bytes, done: int, file: RemoteFile) -> int:
    """Write all of a chunk; more than the file has is of another file."""
    if done + len(chunk) > file.size:
        raise ServerError(f"{file.name}: the server sends more than the {file.size} bytes that it lists")
    left = memoryview(chunk)
    while left:
        left = left[content.write(left) :]  # type: ignore[attr-defined]
    return done + len(chunk)


def _size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0
