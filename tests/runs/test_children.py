"""The death of a worker that is noticed late does not hide what went wrong."""

import json
import os
import signal
from pathlib import Path
from types import FrameType

from refusals import refused

from col3d.errors import UserError
from col3d.runs.status import JobStatus, reported
from col3d.signals import children_unheard


def angry(number: int, frame: FrameType | None) -> None:
    raise RuntimeError("DataLoader worker is killed")


def failing(folder: Path) -> None:
    """A run that fails, while a child dies just as that is written down."""
    with reported(JobStatus(folder)) as status:
        status.write("running")
        write = status.write

        def write_while_a_child_dies(*given: object, **more: object) -> None:
            os.kill(os.getpid(), signal.SIGCHLD)
            write(*given, **more)  # type: ignore[arg-type]

        status.write = write_while_a_child_dies  # type: ignore[method-assign]
        raise UserError("data.workers: gone")


def test_an_error_is_written_down_whatever_children_do(tmp_path: Path) -> None:
    before = signal.signal(signal.SIGCHLD, angry)
    try:
        with refused(UserError, "data.workers", "gone"):
            failing(tmp_path)
        assert json.loads((tmp_path / "status.json").read_text())["error"] == "data.workers: gone"
        assert signal.getsignal(signal.SIGCHLD) is angry
    finally:
        signal.signal(signal.SIGCHLD, before)


def test_they_are_heard_again_afterwards() -> None:
    before = signal.signal(signal.SIGCHLD, angry)
    try:
        with children_unheard():
            os.kill(os.getpid(), signal.SIGCHLD)
        with refused(RuntimeError, None, "is killed"):
            os.kill(os.getpid(), signal.SIGCHLD)
    finally:
        signal.signal(signal.SIGCHLD, before)
