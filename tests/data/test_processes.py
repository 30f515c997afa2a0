"""Folders that are there whole or not at all, whatever happens while they are filled."""

import errno
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from col3d.checks import UserError
from col3d.data.processes import in_processes, whole_folder


def test_a_full_disk_is_said_of_the_folder(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="No space left") as raised, whole_folder(tmp_path / "video"):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert raised.value.filename == str(tmp_path / "video")
    with pytest.raises(OSError, match=r"^a\.png: could not be written$"), whole_folder(tmp_path / "video"):
        raise OSError("a.png: could not be written")
    assert list(tmp_path.iterdir()) == []


def killed(number: int, frame_done: Callable[[], None]) -> int:
    if number == 1:
        os.kill(os.getpid(), 9)
    return number


def test_a_worker_that_the_system_ended_is_a_line() -> None:
    with pytest.raises(UserError, match=r"^prepare: the system ended a worker, .* workers=\.\.\.") as raised:
        in_processes(killed, [(0,), (1,), (2,)], "prepare", 3, workers=2, progress=False)
    assert "\n" not in str(raised.value)
