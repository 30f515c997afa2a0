"""col3d download from a server to folders that are checked, and everything that may come between."""

import errno
import fcntl
import shutil
import signal
import threading
import time
from collections import namedtuple
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dataverse import Dataverse, served, zipped
from programs import call
from refusals import refusal, refused
from signalled import stopped
from tiny_run import composed

from col3d.data.datasets.c3vd import C3VD
from col3d.data.download import plan as download_plan
from col3d.data.download import transfer
from col3d.data.download.download import download
from col3d.data.files.encode import depth_codes, write_tiff
from col3d.errors import DataError, RunLockedError, UserError

pytestmark = pytest.mark.end_to_end

VIDEO, NAME, FRAMES = "trans_t1_a", "c0_transverse_t1_v1", 61
OTHER, OTHER_NAME = "trans_t2_b", "c0_transverse_t2_v2"
POSE = "1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1\n"
ACCEPT = "accept_licence=true"
TIMES = ("attempts=2", "timeout=5")


@pytest.fixture(scope="module")
def archive(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A video of a wall at 50 mm, at the size of C3VD's frames, wrapped in a folder as published ones are."""
    folder = tmp_path_factory.mktemp("frame")
    write_tiff(folder / "depth.tiff", depth_codes(np.full((1080, 1350), 50.0, np.float32), 100.0))
    normals = np.full((1080, 1350, 3), 32768, np.uint16)
    normals[..., 2] = 0
    write_tiff(folder / "normals.tiff", normals)
    import cv2

    cv2.imwrite(str(folder / "color.png"), np.zeros((1080, 1350, 3), np.uint8))
    kinds = ("depth.tiff", "normals.tiff", "color.png")
    content = {kind: (folder / kind).read_bytes() for kind in kinds}
    files = {f"{NAME}/{k:04d}_{kind}": data for k in range(FRAMES) for kind, data in content.items()}
    return zipped(files | {f"{NAME}/pose.txt": POSE.encode() * FRAMES})


@pytest.fixture
def server(archive: bytes) -> Iterator[Dataverse]:
    with served(Dataverse({f"{NAME}.zip": archive})) as has:
        yield has


def options(server: Dataverse, root: Path, *more: str) -> list[str]:
    return [f"data.root={root}", f"server={server.url}", f"videos=[{VIDEO}]", *TIMES, *more]


def run(server: Dataverse, root: Path, *more: str) -> None:
    download(composed("download", *options(server, root, *more)))


def names(root: Path) -> list[str]:
    return sorted(path.name for path in root.iterdir())


def test_a_video_is_there_afterwards(server: Dataverse, tmp_path: Path) -> None:
    root = tmp_path / "C3VD"
    answer = call("download", *options(server, root, ACCEPT), cwd=tmp_path)
    assert answer.returncode == 0, answer.stderr
    lines = answer.stdout.splitlines()
    assert lines[0].split() == [VIDEO, f"{NAME}.zip", "61", "frames", "0.00", "GB"]
    assert lines[2].startswith("licence: CC BY-NC-SA 4.0 (attribution, no commercial use, share alike)")
    assert "GB to fetch" in lines[3]
    assert lines[-2] == f"{VIDEO}: 61 frames, 61 poses"
    assert lines[-1].startswith("1 of 1 videos are whole; col3d verify data=c3vd data.root=")
    assert names(root) == [".col3d_download", NAME]
    frames = C3VD(root, [VIDEO])
    assert len(frames) == FRAMES
    assert frames[0]["depth"][0, 500, 600].item() == pytest.approx(50.0, abs=1e-3)

    server.fetched.clear()
    again = call("download", *options(server, root, ACCEPT), cwd=tmp_path)
    assert (again.returncode, server.fetched) == (0, [])
    assert again.stdout.splitlines()[0] == f"{VIDEO}: 61 frames, 61 poses"


def test_without_a_licence_nothing_is_fetched(server: Dataverse, tmp_path: Path) -> None:
    answer = call("download", *options(server, tmp_path / "C3VD"), cwd=tmp_path)
    assert answer.returncode == 2
    refused = refusal(answer.stderr)
    assert refused.about == "accept_licence"
    assert "CC BY-NC-SA 4.0" in refused.message
    assert "accept_licence=true" in refused.message
    assert f"{NAME}.zip" in answer.stdout
    assert "1 videos, 0.00 GB" in answer.stdout
    assert (server.fetched, list(tmp_path.iterdir())) == ([], [])


def test_archives_stay_where_that_is_asked_for(server: Dataverse, archive: bytes, tmp_path: Path) -> None:
    run(server, tmp_path, ACCEPT, "keep=true")
    assert names(tmp_path) == [".col3d_download", NAME, f"{NAME}.zip"]
    assert (tmp_path / f"{NAME}.zip").read_bytes() == archive


def test_a_folder_that_is_there_stays_as_it_is(
    server: Dataverse, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / VIDEO).mkdir()
    (tmp_path / VIDEO / "mine.txt").write_text("mine")
    with pytest.raises(SystemExit) as ended:
        run(server, tmp_path, ACCEPT)
    assert ended.value.code == 1
    said = capsys.readouterr().out
    assert f"fault: {tmp_path / VIDEO}: no frames" in said
    assert "0 of 1 videos are whole" in said
    assert (server.fetched, names(tmp_path), names(tmp_path / VIDEO)) == ([], [VIDEO], ["mine.txt"])


def test_an_archive_of_the_users_is_read_and_kept(server: Dataverse, archive: bytes, tmp_path: Path) -> None:
    (tmp_path / f"{NAME}.zip").write_bytes(archive)
    run(server, tmp_path, ACCEPT)
    assert names(tmp_path) == [".col3d_download", NAME, f"{NAME}.zip"]
    assert f"{NAME}.zip" not in (tmp_path / ".col3d_download").read_text().splitlines()


@pytest.mark.parametrize("name", [f"{NAME}.zip", f"{NAME}.zip.partial", f".{NAME}.partial", NAME])
def test_what_is_of_others_is_not_written_over(server: Dataverse, tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"mine")
    with refused(UserError, "data.root", tmp_path, name):
        run(server, tmp_path, ACCEPT)
    assert names(tmp_path) == [name]
    assert (tmp_path / name).read_bytes() == b"mine"


def test_a_users_archive_with_another_content(server: Dataverse, archive: bytes, tmp_path: Path) -> None:
    (tmp_path / f"{NAME}.zip").write_bytes(archive[:-1] + b"x")
    with refused(UserError, "data.root", tmp_path / f"{NAME}.zip", "md5"):
        run(server, tmp_path, ACCEPT)
    assert (tmp_path / f"{NAME}.zip").stat().st_size == len(archive)
    assert not (tmp_path / NAME).exists()


def test_a_disk_that_is_too_small_is_said_before(
    server: Dataverse, archive: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage(10**12, 10**12, len(archive)))
    with refused(UserError, "data.root", "GB to fetch", "GB unpacked", "GB free"):
        run(server, tmp_path / "C3VD", ACCEPT)
    assert list(tmp_path.iterdir()) == []
    assert all(server.ranges)  # but for the archive's table of contents


def test_a_disk_that_fills_up_leaves_a_part(
    server: Dataverse, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(transfer, "append", full)
        with refused(OSError, None) as caught:
            run(server, tmp_path, ACCEPT)
    partial = str(tmp_path / f"{NAME}.zip.partial")
    assert (caught.value.errno, caught.value.filename) == (errno.ENOSPC, partial)
    run(server, tmp_path, ACCEPT)
    assert names(tmp_path) == [".col3d_download", NAME]


@pytest.mark.parametrize("signum", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_leaves_what_goes_on(
    server: Dataverse, archive: bytes, tmp_path: Path, signum: signal.Signals
) -> None:
    server.slow = 0.3
    partial = tmp_path / f"{NAME}.zip.partial"
    code, said, complained = stopped(
        "download",
        *options(server, tmp_path, ACCEPT),
        cwd=tmp_path,
        signum=signum,
        ready=lambda: partial.exists() and partial.stat().st_size > 0,
    )
    assert (code, complained) == ({signal.SIGINT: 130, signal.SIGTERM: 143}[signum], "")
    assert said.splitlines()[-1] == (
        f"stopped; what was fetched stays in {tmp_path}, and the same command goes on there"
    )
    there = partial.stat().st_size
    assert partial.read_bytes() == archive[:there]
    server.slow = 0.0
    run(server, tmp_path, ACCEPT)
    assert server.ranges[-1] == f"bytes={there}-"
    assert names(tmp_path) == [".col3d_download", NAME]


def test_one_that_fails_keeps_no_other_from_coming(
    server: Dataverse, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    server.files[f"{OTHER_NAME}.zip"], server.checksums[f"{OTHER_NAME}.zip"] = zipped({"a": b"b"}), "1" * 32
    with refused(UserError, f"{OTHER_NAME}.zip", "md5", "1" * 32) as caught:
        run(server, tmp_path, ACCEPT, f"videos=[{OTHER},{VIDEO}]")
    assert "\n" not in str(caught.value)
    assert names(tmp_path) == [".col3d_download", NAME]
    assert f"{tmp_path / NAME}: there" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("content", "named"),
    [
        (zipped({"../../out.txt": b"x"}), "'../../out.txt'"),
        (zipped({"a/b.txt": b"x"})[:-30], "not a whole archive"),
        (b"<html>", "not a whole archive"),
    ],
    ids=["leads out", "truncated", "no archive"],
)
def test_archives_that_are_none(server: Dataverse, tmp_path: Path, content: bytes, named: str) -> None:
    server.files[f"{NAME}.zip"] = content
    root = tmp_path / "a" / "b"
    answer = call("download", *options(server, root, ACCEPT), cwd=tmp_path)
    assert answer.returncode == 2
    assert refusal(answer.stderr).about == f"{root / NAME}.zip"
    assert named in answer.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["a"]
    assert NAME not in names(root)


def test_a_video_with_frames_missing_is_a_fault(
    server: Dataverse, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run(server, tmp_path, ACCEPT)
    for path in (tmp_path / NAME).glob("0060_*"):
        path.unlink()
    with pytest.raises(SystemExit) as ended:
        run(server, tmp_path, ACCEPT)
    assert ended.value.code == 1
    assert f"fault: {tmp_path / NAME}: expected 61 frames, got 60" in capsys.readouterr().out


def test_two_at_a_time_are_refused(server: Dataverse, tmp_path: Path) -> None:
    with (tmp_path / ".col3d_download").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        with refused(RunLockedError, "data.root", tmp_path):
            run(server, tmp_path, ACCEPT)
    assert names(tmp_path) == [".col3d_download"]


def test_threads_end_with_the_program(server: Dataverse, tmp_path: Path) -> None:
    before = threading.active_count()
    run(server, tmp_path, ACCEPT, "parallel=4")
    end = time.monotonic() + 10
    while threading.active_count() > before + 4 and time.monotonic() < end:  # the server's own may linger
        time.sleep(0.02)
    assert not [thread for thread in threading.enumerate() if "_serve" in thread.name]


@pytest.mark.parametrize(
    ("given", "about", "named"),
    [
        (["videos=cecum_t1_a"], "videos", ("'split' or 'all'", "[a,b]", "'cecum_t1_a'")),
        (["videos=[cecum_t1_x]"], "videos", ("'cecum_t1_x'", "c3vd", "'cecum_t1_")),
        (["videos=[c1_cecum_t1_v1]"], "videos", ("c1_cecum_t1_v1", "data=c3vdv2")),
        (["videos=[zzz*]"], "split entry 'zzz*'", ("no video",)),
        (["videos=[]"], "videos", ()),
        (["videos=train"], "videos", ("'train'",)),
        (["data=c3vdv2"], "videos", ("data.split", "videos=all")),
        (["data=simcol3d"], "data", ("c3vd and c3vdv2", "data=simcol3d")),
        (["server=ftp://x"], "server", ("https://", "ftp://x")),
        (["doi=jhu/x"], "doi", ("doi:10.7281/T1/JC64MK", "jhu/x")),
        (["parallel=0"], "parallel", (0,)),
        (["attempts=0"], "attempts", (0,)),
        (["timeout=0"], "timeout", (0,)),
    ],
)
def test_what_no_option_may_be(
    given: list[str], about: str, named: tuple[object, ...], tmp_path: Path
) -> None:
    with refused((DataError, UserError), about, *named) as caught:
        download(
            composed(
                "download",
                *given,
                f"data.root={tmp_path}",
                *([] if "server" in given[0] else ["server=http://127.0.0.1:9"]),
            )
        )
    assert len(str(caught.value).splitlines()) == 1


def test_a_root_that_is_a_file(server: Dataverse, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with refused(UserError, "data.root", tmp_path / "file"):
        run(server, tmp_path / "file", ACCEPT)


def test_a_video_that_the_server_has_not(server: Dataverse, tmp_path: Path) -> None:
    with refused(DataError, "videos", OTHER_NAME):
        run(server, tmp_path, ACCEPT, f"videos=[{VIDEO},{OTHER}]")
    assert names(tmp_path) == []


@pytest.mark.parametrize(
    ("given", "count"),
    [
        (["videos=split"], 21),
        (["videos=all"], 26),
        (["videos=[c1v1,c0_cecum_t1_v1,cecum_t1_a:0-3]"], 1),
        (["data/split=ppsnet"], 22),
        (["data=c3vdv2", "videos=[c1_cecum_*]"], None),
    ],
)
def test_which_videos_are_meant(given: list[str], count: int | None, tmp_path: Path) -> None:
    from col3d.data.download.options import DownloadOptions

    found = download_plan.named_videos(
        DownloadOptions.model_validate(composed("download", *given, f"data.root={tmp_path}"))
    )
    assert len(found) == len(set(found))
    assert len(found) == count if count else found and all("_cecum_" in name for name in found)
    assert list(tmp_path.iterdir()) == []
