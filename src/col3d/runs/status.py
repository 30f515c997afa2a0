"""status.json: the state and progress of a training."""

import os
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from col3d.io.json_files import write_json
from col3d.io.run_files import STATUS, read_plain
from col3d.runs.provenance import command
from col3d.runs.rank import is_first
from col3d.signals import Stopped, children_unheard

LONGEST_ERROR = 500


class JobStatus:
    """Writer of status.json: running, done, failed or preempted, since when, how far, and why it failed.

    Args:
        folder: folder of the training.
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
        """Whether the status has been written by this process."""
        return "updated" in self.content

    @property
    def seconds(self) -> float:
        """Seconds of work, in all sessions."""
        return self.seconds_before + time.monotonic() - self.start

    def write(self, state: str, **facts: Any) -> None:
        """Update the file; of several processes only the first one writes, but any may report a failure."""
        if not is_first() and state != "failed":
            return
        self.content |= {"state": state, "seconds": round(self.seconds, 1), "updated": _now(), **facts}
        write_json(self.path, self.content)


def _number(value: Any) -> float:
    """Convert a number of an earlier session; 0 if its file holds something else."""
    return float(value) if isinstance(value, int | float) else 0.0


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


@contextmanager
def reported(status: JobStatus) -> Iterator[JobStatus]:
    """Write how the block ends; an error before the status is first written leaves no file."""
    try:
        yield status
    except Stopped as stopped:
        status.write("preempted", signal=stopped.signum)
        raise
    except BaseException as error:
        if status.begun:
            with suppress(OSError), children_unheard():  # the error may be a full disk
                status.write("failed", error=_last_line(error))
        raise
    status.write("done")


def _last_line(error: BaseException) -> str:
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    name = "" if type(error).__name__ in ("UserError", "DataError") else f"{type(error).__name__}: "
    return f"{name}{lines[-1] if lines else ''}"[:LONGEST_ERROR]
