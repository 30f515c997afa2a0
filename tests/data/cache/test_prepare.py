"""Prepared frames: whole or not there, the same after a kill, found by a training, refused when stale."""

import errno
import hashlib
import json
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from programs import call, command
from refusals import refused
from tiny_run import composed

from col3d.data.build import data_module, frame_set
from col3d.data.cache import Stored
from col3d.data.cache import prepare as preparing
from col3d.data.cache import write as writing
from col3d.data.cache.choice import KNOWN, beside, stored_frames
from col3d.data.cache.prepare import prepare
from col3d.data.sized import Resized
from col3d.errors import DataError, UserError
from col3d.registry.refusals import check_options
from col3d.training.options import TrainOptions

pytestmark = pytest.mark.end_to_end

PHANTOM = ("phantom.size=[64,80]", "phantom.frames_per_video=3")
Compose = Callable[..., dict[str, Any]]


def given(root: Path, *overrides: str) -> dict[str, Any]:
    return composed("prepare", "data=phantom", *PHANTOM, f"data.root={root}", "data.size=[64,80]", *overrides)


def digests(store: Path) -> dict[str, str]:
    """Of every file by its path."""
    files = (path for path in sorted(store.rglob("*")) if path.is_file())
    return {str(path.relative_to(store)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


@pytest.fixture(scope="module")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A phantom of all videos, and its store beside it, both made by the program."""
    root = tmp_path_factory.mktemp("prepared") / "frames"
    answer = call("prepare", *PHANTOM, f"data.root={root}", "data.size=[64,80]", cwd=root.parent)
    assert answer.returncode == 0, answer.stderr
    assert "22 videos of 66 frames at 64 x 80" in answer.stdout
    assert "train.py reads it with data.size=[64,80]\n" in answer.stdout
    return root


@pytest.fixture
def root(rendered: Path, tmp_path: Path) -> Path:
    """A copy of the phantom and its store, to be changed."""
    shutil.copytree(rendered.parent, tmp_path / "data", copy_function=shutil.copy2)
    return tmp_path / "data" / "frames"


def training_frames(tiny: Compose, root: Path, *overrides: str) -> Any:
    options = check_options(TrainOptions, tiny(f"data.root={root}", *overrides))
    return data_module(options.data, options.phantom, 0).frames["train"]


def test_a_training_reads_what_was_prepared(root: Path, tiny: Compose, capsys: Any) -> None:
    assert isinstance(training_frames(tiny, root), Stored)
    assert capsys.readouterr().out == f"reads frames prepared in {beside(root, (64, 80))}\n"
    assert isinstance(training_frames(tiny, root, "data.store=none"), Resized)
    assert isinstance(training_frames(tiny, root, "data.size=[64,96]"), Resized)
    assert capsys.readouterr().out == ""


def test_prepared_frames_of_the_phantom_are_those_of_the_files(rendered: Path, tiny: Compose) -> None:
    stored = training_frames(tiny, rendered)
    files = training_frames(tiny, rendered, "data.store=none")
    assert len(stored) == len(files) == 5
    for index in range(5):
        for key in ("image", "depth", "normals", "mask", "rays"):
            assert torch.equal(stored[index][key], files[index][key]), key


def test_a_stale_store_is_noticed_and_left_aside(root: Path, tiny: Compose, capsys: Any) -> None:
    path = root / "trans_t1_a" / "0001_depth.tiff"
    os.utime(path)
    assert isinstance(training_frames(tiny, root), Resized)
    assert f"does not serve: {path} has changed since" in capsys.readouterr().out
    store = beside(root, (64, 80))
    with refused(DataError, f"data.store={store}", f"{path} has changed", "col3d prepare"):
        training_frames(tiny, root, f"data.store={store}")
    prepare(given(root))
    assert "1 now, 21 before" in capsys.readouterr().out
    assert isinstance(training_frames(tiny, root), Stored)


@pytest.mark.parametrize(
    ("overrides", "reason"),
    [
        (("data.normals=derived",), "was prepared otherwise (normals is stored, not derived)"),
        (("data.release=pre_2023_05", "data.normals=stored"), "was prepared as release current, not pre"),
    ],
)
def test_a_store_of_another_kind_does_not_serve(
    root: Path, tiny: Compose, capsys: Any, overrides: tuple[str, ...], reason: str
) -> None:
    if "data.release=pre_2023_05" in overrides:
        with refused(DataError, None, "data.release=pre_2023_05"):
            training_frames(tiny, root, *overrides)
    else:
        assert isinstance(training_frames(tiny, root, *overrides), Resized)
        assert reason in capsys.readouterr().out


def test_a_truncated_array_is_found_before_training(root: Path, tiny: Compose) -> None:
    path = beside(root, (64, 80)) / "cecum_t1_a" / "image.npy"
    os.truncate(path, path.stat().st_size - 10)
    with refused(DataError, path, "bytes"):
        training_frames(tiny, root)
    prepare(given(root))
    assert isinstance(training_frames(tiny, root), Stored)


def test_another_place_is_remembered(root: Path, tiny: Compose, tmp_path: Path, capsys: Any) -> None:
    shutil.rmtree(beside(root, (64, 80)))
    place = tmp_path / "fast_disk" / "frames"
    prepare(given(root, f"prepare.out={place}"))
    assert json.loads((root / KNOWN).read_text()) == [str(place)]
    assert isinstance(training_frames(tiny, root), Stored)
    assert f"reads frames prepared in {place}" in capsys.readouterr().out


def test_a_store_serves_without_the_files(root: Path, tiny: Compose, capsys: Any) -> None:
    store = beside(root, (64, 80))
    options = check_options(TrainOptions, tiny(f"data.root={root}", f"data.store={store}"))
    expected = Resized(frame_set(options.data, options.phantom, ["trans_t1_a:1-2"]), (64, 80))[1]
    shutil.rmtree(root)
    frames = frame_set(options.data, options.phantom, [])
    found = stored_frames(options.data, frames, ["cecum_t1_a", "trans_t1_a:1-2"], (64, 80), print)
    assert found is not None
    assert capsys.readouterr().out == f"reads frames prepared in {store}\n"
    assert [int(found[index]["frame"]) for index in range(5)] == [0, 1, 2, 1, 2]
    assert torch.equal(found[4]["depth"], expected["depth"])


def test_a_second_run_changes_nothing(root: Path, capsys: Any) -> None:
    store = beside(root, (64, 80))
    before = digests(store)
    times = {path: path.stat().st_mtime_ns for path in store.rglob("*")}
    prepare(given(root))
    assert "0 now, 22 before" in capsys.readouterr().out
    assert digests(store) == before
    assert {path: path.stat().st_mtime_ns for path in store.rglob("*")} == times


def test_killed_at_any_moment_it_ends_the_same(rendered: Path, tmp_path: Path) -> None:
    """Three kills, each a little later than the first folder of a video is begun; then to the end."""
    whole, store = beside(rendered, (64, 80)), tmp_path / "store"
    arguments = (*PHANTOM, f"data.root={rendered}", "data.size=[64,80]", f"prepare.out={store}")
    words = [*command("prepare"), *arguments, "workers=2"]
    for kill in range(3):
        process = subprocess.Popen(words, stdout=subprocess.DEVNULL, start_new_session=True)
        begun = len(list(store.glob("*"))) if store.exists() else 0
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline and process.poll() is None:
            if store.exists() and len(list(store.glob("[!.]*"))) > begun + kill:
                break
            time.sleep(0.002)
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        for index in store.glob("[!.]*/index.json"):  # what looks finished is finished
            assert digests(index.parent) == digests(whole / index.parent.name)
    answer = call("prepare", *arguments, cwd=tmp_path)
    assert answer.returncode == 0, answer.stderr
    assert digests(store) == digests(whole)
    (rendered / KNOWN).unlink()


def test_workers_end_with_a_parent_that_was_killed(rendered: Path, tmp_path: Path) -> None:
    store = tmp_path / "store"
    arguments = (*PHANTOM, f"data.root={rendered}", "data.size=[64,80]", f"prepare.out={store}", "workers=2")
    words = [*command("prepare"), *arguments]
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL, start_new_session=True)
    deadline = time.monotonic() + 100
    while not list(store.glob("[!.]*")) and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.01)
    process.kill()
    process.wait()
    while time.monotonic() < deadline:
        try:
            os.killpg(process.pid, 0)
        except ProcessLookupError:
            break
        time.sleep(0.05)
    else:
        pytest.fail("workers went on without their parent")


def test_a_full_disk_ends_in_one_line(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written, put = [], writing.ArrayFile.put

    def put_until_full(self: Any, content: bytes) -> None:
        written.append(len(content))
        if sum(written) > 400_000:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        put(self, content)

    monkeypatch.setattr(writing.ArrayFile, "put", put_until_full)
    store = tmp_path / "small_disk"
    with refused(UserError, f"prepare.out={store}", "full"):
        prepare(given(root, f"prepare.out={store}", "workers=1"))
    whole = digests(beside(root, (64, 80)))
    found = digests(store)
    assert 0 < len(found) < len(whole)
    assert found.items() <= whole.items()
    assert not list(store.glob(".*"))


def test_too_little_space_is_said_before_work_starts(root: Path, tmp_path: Path, monkeypatch: Any) -> None:
    nearly_full = SimpleNamespace(total=10, used=9, free=1)
    monkeypatch.setattr(preparing.shutil, "disk_usage", lambda path: nearly_full)
    with refused(UserError, f"prepare.out={tmp_path / 'small'}", "3.4 MB", "66 frames", "0.0 MB"):
        prepare(given(root, f"prepare.out={tmp_path / 'small'}"))


def test_broken_files_are_listed_and_the_rest_is_prepared(
    root: Path, tmp_path: Path, monkeypatch: Any
) -> None:
    monkeypatch.setattr(preparing, "render_missing", lambda *_, **__: None)  # it would mend them
    broken = [root / "cecum_t1_a" / "0001_color.png", root / "desc_t4_a" / "0000_depth.tiff"]
    store = tmp_path / "store"
    for path in broken:
        path.write_bytes(path.read_bytes()[:-200])
    with refused(UserError, broken[0]) as error:
        prepare(given(root, f"prepare.out={store}"))
    lines = str(error.value).splitlines()
    assert len(lines) == 2
    for line, path in zip(lines, broken, strict=True):
        assert line.startswith(f"{path}: ")
        assert "the file is cut off" in line or "not a readable image" in line
    assert len(list(store.iterdir())) == 20


@pytest.mark.parametrize(
    ("name", "named"),
    [("frames", ("data.root ",)), ("other", ("other: ", "notes ")), ("file", ("file: ", "a folder"))],
)
def test_a_place_that_holds_anything_else_is_refused(root: Path, name: str, named: tuple[str, ...]) -> None:
    (root.parent / "other" / "notes").mkdir(parents=True)
    (root.parent / "file").touch()
    with refused(UserError, None, *named):
        prepare(given(root, f"prepare.out={root.parent / name}"))


def test_a_store_of_another_size_is_not_overwritten(root: Path) -> None:
    store = beside(root, (64, 80))
    before = digests(store)
    with refused(UserError, None, "size is [64, 80], not [64, 64]"):
        prepare(given(root, "data.size=[64,64]", f"prepare.out={store}"))
    assert digests(store) == before
