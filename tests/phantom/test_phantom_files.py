"""Rendering what is missing, refusing what is foreign, and giving the same bytes each time."""

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from refusals import refused

from col3d.errors import DataError
from col3d.phantom import PhantomSettings, phantom_is_complete, render_phantom
from col3d.phantom.write import MANIFEST

FIRST, SECOND = "cecum_t1_a", "sigmoid_t3_b"


@pytest.fixture
def root(small_root: Path, tmp_path: Path) -> Path:
    """A copy to damage."""
    return Path(shutil.copytree(small_root, tmp_path / "phantom"))


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def stamps(folder: Path) -> dict[str, int]:
    return {path.name: path.stat().st_mtime_ns for path in folder.iterdir()}


def test_bytes_do_not_depend_on_the_number_of_workers(
    small_root: Path, small: PhantomSettings, tmp_path: Path
) -> None:
    render_phantom(tmp_path / "other", small, workers=2, progress=False)
    assert contents(tmp_path / "other") == contents(small_root)


def test_another_seed_gives_another_colon(small_root: Path, small: PhantomSettings, tmp_path: Path) -> None:
    render_phantom(tmp_path, replace(small, seed=1, videos=(FIRST,)), workers=1, progress=False)
    for name in ("0000_depth.tiff", "0000_color.png", "pose.txt"):
        assert (tmp_path / FIRST / name).read_bytes() != (small_root / FIRST / name).read_bytes()


def test_a_video_does_not_depend_on_its_company(
    small_root: Path, small: PhantomSettings, tmp_path: Path
) -> None:
    render_phantom(tmp_path, replace(small, videos=(SECOND,)), workers=1, progress=False)
    assert contents(tmp_path / SECOND) == contents(small_root / SECOND)


def test_complete_videos_stay_untouched(root: Path, small: PhantomSettings) -> None:
    before = stamps(root / FIRST)
    assert phantom_is_complete(root, small)
    render_phantom(root, small, progress=False)
    assert stamps(root / FIRST) == before


def delete(path: Path) -> None:
    path.unlink()


def cut(path: Path) -> None:
    os.truncate(path, path.stat().st_size // 2)


@pytest.mark.parametrize("damage", [delete, cut])
@pytest.mark.parametrize("name", ["0001_normals.tiff", "pose.txt"])
def test_a_damaged_video_alone_is_rendered_anew(
    root: Path, small_root: Path, small: PhantomSettings, damage: object, name: str
) -> None:
    assert callable(damage)
    damage(root / FIRST / name)
    before = stamps(root / SECOND)
    assert not phantom_is_complete(root, small)
    render_phantom(root, small, progress=False)
    assert contents(root) == contents(small_root)
    assert stamps(root / SECOND) == before


def test_a_cut_manifest_is_not_trusted(root: Path, small_root: Path, small: PhantomSettings) -> None:
    cut(root / FIRST / MANIFEST)
    render_phantom(root, small, progress=False)
    assert contents(root) == contents(small_root)


def test_what_an_interrupted_process_left_is_removed(root: Path, small: PhantomSettings) -> None:
    left = root / ".partial-cecum_t2_a-999999999"
    left.mkdir()
    (left / "0000_color.png").write_bytes(b"")
    render_phantom(root, small, progress=False)
    assert not left.exists()


def test_a_failed_video_leaves_nothing(
    small: PhantomSettings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise OSError("no space left")

    monkeypatch.setattr("col3d.phantom.write.write_manifest", fail)
    with refused(OSError, None, "no space left"):
        render_phantom(tmp_path, replace(small, frames_per_video=1), workers=1, progress=False)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("other", "named"),
    [
        ({"size_hw": (56, 68)}, ("size_hw is ", "56", "68")),
        ({"seed": 3}, ("seed is 0", "not 3")),
        ({"frames_per_video": 4}, ("frames", "not 4")),
    ],
)
def test_other_settings_are_refused(
    root: Path, small: PhantomSettings, other: dict[str, object], named: tuple[str, ...]
) -> None:
    before = contents(root)
    settings = PhantomSettings(**{**vars(small), **other})  # type: ignore[arg-type]
    assert not phantom_is_complete(root, settings)
    with refused(DataError, None, root, *named):
        render_phantom(root, settings, progress=False)
    assert contents(root) == before


def test_a_folder_of_other_data_is_refused(small: PhantomSettings, tmp_path: Path) -> None:
    real = tmp_path / FIRST / "0000_color.png"
    real.parent.mkdir()
    real.write_bytes(b"real")
    with refused(DataError, tmp_path, FIRST, "phantom.json"):
        render_phantom(tmp_path, small, progress=False)
    assert contents(tmp_path) == {f"{FIRST}/0000_color.png": b"real"}


def test_the_manifest_lists_every_other_file(small_root: Path) -> None:
    manifest = json.loads((small_root / FIRST / MANIFEST).read_text(encoding="utf-8"))
    sizes = {
        path.name: path.stat().st_size for path in (small_root / FIRST).iterdir() if path.name != MANIFEST
    }
    assert manifest["files"] == sizes


@pytest.mark.parametrize(
    ("other", "about", "named"),
    [
        ({"size_hw": (4, 300)}, "size_hw", ("(4, 300)",)),
        ({"frames_per_video": 0}, "frames_per_video", ("got 0",)),
        ({"seed": -1}, "seed", ("got -1",)),
        ({"videos": ("cecum_t1_z",)}, None, ("'cecum_t1_z'", "did you mean 'cecum_t1_")),
    ],
)
def test_wrong_settings_are_named(
    other: dict[str, object], about: str | None, named: tuple[str, ...]
) -> None:
    with refused(ValueError, about, *named):
        PhantomSettings(**other)  # type: ignore[arg-type]
