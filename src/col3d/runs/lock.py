"""The lock of a run's folder: one process at a time trains in it."""

import fcntl
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from col3d.errors import RunLockedError
from col3d.reports.jobs import LOCK, STATUS, read_plain
from col3d.runs.rank import is_first

TRIES, PAUSE = 10, 0.05
"""A reader of the folder holds the lock for a moment, too."""


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold a folder against other processes; the system lets go of it when this one ends in any way.

    The lock is of POSIX's kind, which processes that are forked, as workers of loaders, do not hold on to. Of
    the processes of one training the first does it for all.

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
        with suppress(OSError):  # a disk that became read-only; what went wrong has been said
            if not os.fstat(descriptor).st_size:  # a file of others has something in it
                path.unlink()
        os.close(descriptor)
        for parent in made:
            with suppress(OSError):  # a run has begun in it
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
    said = read_plain(path.with_name(STATUS))
    who = f" (process {said['process']} on {said.get('host', 'some host')})" if "process" in said else ""
    raise RunLockedError(f"{path.parent} is being trained by another process{who}")


def _is(path: Path, descriptor: int) -> bool:
    """Whether a file is still the one that was opened: whoever had it before removed it at the end."""
    with suppress(FileNotFoundError):
        return os.path.samestat(path.stat(), os.fstat(descriptor))
    return False
