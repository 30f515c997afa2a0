"""Archives of any wrapping become one folder; what would lead out of it, or is broken, leaves nothing."""

import threading
from pathlib import Path

import pytest
from dataverse import zipped
from refusals import refused

from col3d.data.download import Interrupted, unpack
from col3d.errors import DataError

FILES = {"rgb/0000.png": b"red", "depth/0000_depth.tiff": b"deep", "pose.txt": b"1,0"}


def unpacked(folder: Path, content: bytes) -> Path:
    archive = folder / "v.zip"
    archive.write_bytes(content)
    unpack(archive, folder / "v", folder / ".v.partial", threading.Event())
    return folder / "v"


def files_in(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.mark.parametrize("wrap", ["", "v/", "c0_cecum_t1_v1/", "data/v/v/"])
def test_folders_around_a_video_are_left_out(tmp_path: Path, wrap: str) -> None:
    content = zipped(
        {wrap + name: data for name, data in FILES.items()} | {"__MACOSX/._x": b"", ".DS_Store": b""}
    )
    assert files_in(unpacked(tmp_path, content)) == FILES
    assert sorted(path.name for path in tmp_path.iterdir()) == ["v", "v.zip"]


def test_a_kind_of_files_is_no_wrapping(tmp_path: Path) -> None:
    assert files_in(unpacked(tmp_path, zipped({"v/rgb/0000.png": b"red"}))) == {"rgb/0000.png": b"red"}


@pytest.mark.parametrize(
    "name", ["../out.txt", "a/../../out.txt", "/out.txt", "C:\\out.txt", "..\\out.txt", "a\\..\\..\\out.txt"]
)
def test_entries_that_lead_out_are_refused(tmp_path: Path, name: str) -> None:
    with refused(DataError, tmp_path / "v.zip", repr(name), "out of its folder"):
        unpacked(tmp_path, zipped(FILES | {name: b"x"}))
    assert [path.name for path in tmp_path.iterdir()] == ["v.zip"]
    assert not (tmp_path.parent / "out.txt").exists()


def test_links_are_refused(tmp_path: Path) -> None:
    with refused(DataError, tmp_path / "v.zip", "'rgb/link'", "out of its folder"):
        unpacked(tmp_path, zipped(FILES, links={"rgb/link": "/etc/passwd"}))


def test_a_file_that_is_twice_in_it_is_refused(tmp_path: Path) -> None:
    with refused(DataError, tmp_path / "v.zip", "twice"):
        unpacked(tmp_path, zipped({"rgb\\0000.png": b"a", "rgb/0000.png": b"b", "pose.txt": b""}))


@pytest.mark.parametrize("cut", [1, 10, 100])
def test_a_truncated_archive_leaves_nothing(tmp_path: Path, cut: int) -> None:
    content = zipped(FILES)
    with refused(DataError, tmp_path / "v.zip", "not a zip file"):
        unpacked(tmp_path, content[:-cut] if cut > 1 else content[: len(content) // 2])
    assert [path.name for path in tmp_path.iterdir()] == ["v.zip"]


def test_damaged_contents_leave_nothing(tmp_path: Path) -> None:
    content = bytearray(zipped({"a.bin": bytes(range(256)) * 40, "pose.txt": b""}))
    content[60] ^= 0xFF
    with refused(DataError, tmp_path / "v.zip", "'a.bin'"):
        unpacked(tmp_path, bytes(content))
    assert [path.name for path in tmp_path.iterdir()] == ["v.zip"]


def test_an_empty_archive_is_refused(tmp_path: Path) -> None:
    with refused(DataError, tmp_path / "v.zip", "no file"):
        unpacked(tmp_path, zipped({}))


def test_what_a_kill_left_half_unpacked_is_done_anew(tmp_path: Path) -> None:
    (tmp_path / ".v.partial" / "rgb").mkdir(parents=True)
    (tmp_path / ".v.partial" / "rgb" / "stale.png").write_bytes(b"")
    assert files_in(unpacked(tmp_path, zipped(FILES))) == FILES


def test_a_stop_leaves_nothing(tmp_path: Path) -> None:
    stop = threading.Event()
    stop.set()
    (tmp_path / "v.zip").write_bytes(zipped(FILES))
    with pytest.raises(Interrupted):
        unpack(tmp_path / "v.zip", tmp_path / "v", tmp_path / ".v.partial", stop)
    assert [path.name for path in tmp_path.iterdir()] == ["v.zip"]
