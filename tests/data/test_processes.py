"""Folders that are there whole or not at all, whatever happens while they are filled."""

import errno
import json
import os
import shutil
import signal
from collections.abc import Callable
from contextlib import suppress
from multiprocessing import util
from pathlib import Path
from typing import Any

import pytest
from refusals import refused

from col3d.data.processes import in_processes
from col3d.data.whole_folder import remove_stale, whole_folder
from col3d.errors import DataError, UserError


def test_a_full_disk_is_said_of_the_folder(tmp_path: Path) -> None:
    with refused(OSError, None) as raised, whole_folder(tmp_path / "video"):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert (raised.value.errno, raised.value.filename) == (errno.ENOSPC, str(tmp_path / "video"))
    with refused(OSError, "a.png"), whole_folder(tmp_path / "video"):
        raise OSError("a.png: could not be written")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("phantom.json", {"files": {"0000_color.png": 3, "pose.txt": 3}}),
        ("phantom.json", "cut o"),
        ("index.json", {"shards": {"image": {}, "mask": {}}}),
        ("index.json", "cut o"),
    ],
)
def test_a_video_is_replaced_and_what_others_put_into_it_is_not(
    name: str, content: object, tmp_path: Path
) -> None:
    video = tmp_path / "video"
    video.mkdir()
    ours = ("0000_color.png", "pose.txt") if name == "phantom.json" else ("image.npy", "mask.npy")
    for file in ours:
        (video / file).write_text("old")
    (video / name).write_text(json.dumps(content) if isinstance(content, dict) else str(content))
    for mine in ("notes.txt", ".hidden", "folder/0000_color.png"):
        (video / mine).parent.mkdir(exist_ok=True)
        (video / mine).write_text("precious")
        put = (video / mine).relative_to(video).parts[0]
        with refused(DataError, None, f"{video} holds {put}, "), whole_folder(video):
            raise AssertionError("work has begun")
        assert (video / mine).read_text() == "precious"
        assert (video / ours[0]).read_text() == "old"
        shutil.rmtree(video / mine) if (video / mine).is_dir() else (video / mine).unlink()
        with suppress(OSError):
            (video / "folder").rmdir()
    with (
        refused(DataError, None, f"{video} holds late.txt, "),
        whole_folder(video),
    ):
        (video / "late.txt").write_text("precious")
    assert (video / "late.txt").read_text() == "precious"
    (video / "late.txt").unlink()
    with whole_folder(video) as partial:
        (partial / "new.png").write_text("new")
    assert [path.name for path in video.iterdir()] == ["new.png"]
    assert [path.name for path in tmp_path.iterdir()] == ["video"]


def test_a_folder_without_a_list_a_file_and_a_link_stay(tmp_path: Path) -> None:
    (tmp_path / "video").mkdir()
    (tmp_path / "video" / "0000_color.png").write_text("precious")
    (tmp_path / "file").write_text("precious")
    (tmp_path / "link").symlink_to(tmp_path / "video")
    for name in ("video", "file", "link"):
        with refused(DataError, None, f"{tmp_path / name} "), whole_folder(tmp_path / name):
            raise AssertionError("work has begun")
    assert (tmp_path / "video" / "0000_color.png").read_text() == "precious"
    assert (tmp_path / "file").read_text() == "precious"


def test_what_was_left_behind_goes_and_what_only_looks_like_it_stays(tmp_path: Path) -> None:
    left, mine = tmp_path / ".partial-a-999999999", tmp_path / ".partial-b-999999999"
    for folder, name in ((left, "0000_color.png"), (left, "index.json"), (mine, "thesis.txt")):
        folder.mkdir(exist_ok=True)
        (folder / name).write_text("")
    remove_stale(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [mine.name]


def killed(number: int, frame_done: Callable[[], None]) -> int:
    if number == 1:
        os.kill(os.getpid(), 9)
    return number


def test_a_worker_that_the_system_ended_is_a_line() -> None:
    with refused(UserError, "prepare", "workers=") as raised:
        in_processes(killed, [(0,), (1,), (2,)], "prepare", 3, workers=2, progress=False)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("process", [1, 2])
def test_ctrl_c_while_a_worker_starts_is_heard_of_it_alone(
    process: int, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """It comes when the worker runs and waits to hear what it is to do."""
    started, start = [], util.spawnv_passfds

    def interrupted(program: Any, command: list[str], *given: Any) -> int:
        number = start(program, command, *given)
        if "--multiprocessing-fork" in command:
            started.append(number)
            if len(started) == process:
                os.kill(os.getpid(), signal.SIGINT)
        return number

    monkeypatch.setattr(util, "spawnv_passfds", interrupted)
    with pytest.raises(KeyboardInterrupt):
        in_processes(killed, [(0,), (2,)], "prepare", 2, workers=2, progress=False)
    assert len(started) == 2
    assert capfd.readouterr().err == ""
