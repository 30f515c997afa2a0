"""The lock of a run's folder: one process at a time trains in it."""

import fcntl
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from col3d.errors import RunLockedError
from col3d.io.run_files import LOCK, STATUS, read_plain
from col3d.runs.rank import is_first

TRIES, PAUSE = 10, 0.05
"""Retries, because a reader of the folder also holds the lock for a moment."""


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Lock a folder against other processes in the block; the system releases it however this one ends.

    It is a POSIX lock, which forked processes, such as workers of data loaders, do not inherit. Of the
    processes of one training only the first takes it.

    Raises:
        RunLockedError: another process trains there.
    """
    if not is_first():
        yield
        return
    made = [parent for parent in (folder, *folder.parents) if not parent.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / LOCK
    descriptor = _take(path)
    try:
        yield
    finally:
        with suppress(OSError):  # a disk that became read-only; the cause is reported elsewhere
            if not os.fstat(descriptor).st_size:  # a lock of ours is empty
                path.unlink()
        os.close(descriptor)
        for parent in made:
            with suppress(OSError):  # not empty: a run has begun in it
                parent.rmdir()


def _take(path: Path) -> int:
    for left in reversed(range(TRIES)):
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if _is(path, descriptor):
                return descriptor
        except BlockingIOError:
            pass
        except OSError as error:
            print(f"note: {path.parent} cannot be locked ({error.strerror}): train it once", flush=True)
            return descriptor
        os.close(descriptor)
        if left:
            time.sleep(PAUSE)
    state = read_plain(path.with_name(STATUS))
    who = f" (process {state['process']} on {state.get('host', 'some host')})" if "process" in state else ""
    raise RunLockedError(f"{path.parent} is being trained by another process{who}")


def _is(path: Path, descriptor: int) -> bool:
    """Whether a path is still the opened file: the previous owner of the lock removes it at the end."""
    with suppress(FileNotFoundError):
        return os.path.samestat(path.stat(), os.fstat(descriptor))
    return False
