"""A training as a job: its folder belongs to one process at a time, and says what becomes of it."""

import fcntl
import os
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from col3d.errors import RunLockedError
from col3d.io.json_files import write_json
from col3d.reports.jobs import LOCK, STATUS, read_plain
from col3d.runs.provenance import command
from col3d.runs.rank import is_first
from col3d.signals import Stopped, children_unheard

TRIES, PAUSE = 10, 0.05
"""A reader of the folder holds the lock for a moment, too."""
LONGEST_ERROR = 500


class JobStatus:
    """status.json: running, done, failed or preempted, since when, how far, and why it failed.

    Args:
        folder: of the training.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / STATUS
        before = read_plain(self.path)
        self.seconds_before = _number(before.get("seconds"))
        self.start = time.monotonic()
        self.content: dict[str, Any] = {
            "state": "running",
            "command": command(),
            "host": socket.gethostname(),
            "process": os.getpid(),
            "started": before.get("started", _now()),
            "sessions": int(_number(before.get("sessions"))) + 1,
            **{name: before[name] for name in ("epoch", "epochs") if name in before},
        }

    @property
    def begun(self) -> bool:
        """Whether anything is said yet."""
        return "updated" in self.content

    @property
    def seconds(self) -> float:
        """Of work, in all sessions."""
        return self.seconds_before + time.monotonic() - self.start

    def write(self, state: str, **facts: Any) -> None:
        """Say something new; of several processes the first says it, but any may have failed."""
        if not is_first() and state != "failed":
            return
        self.content |= {"state": state, "seconds": round(self.seconds, 1), "updated": _now(), **facts}
        write_json(self.path, self.content)


def _number(said: Any) -> float:
    """What an earlier session counted; nothing where its file was changed."""
    return float(said) if isinstance(said, int | float) else 0.0


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


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


@contextmanager
def reported(status: JobStatus) -> Iterator[JobStatus]:
    """Write how the block ends, if anything has begun in it: a refusal leaves no trace."""
    try:
        yield status
    except Stopped as stopped:
        status.write("preempted", signal=stopped.signum)
        raise
    except BaseException as error:
        if status.begun:
            with suppress(OSError), children_unheard():  # a full disk is among the reasons
                status.write("failed", error=_last_line(error))
        raise
    status.write("done")


def _last_line(error: BaseException) -> str:
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    name = "" if type(error).__name__ in ("UserError", "DataError") else f"{type(error).__name__}: "
    return f"{name}{lines[-1] if lines else ''}"[:LONGEST_ERROR]
