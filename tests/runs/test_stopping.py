"""Programs that are asked to stop, or whose disk is full: what is there is whole, and exit codes say so."""

import csv
import errno
import json
import os
import resource
import shlex
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import pytest
from programs import command
from refusals import refusal, refused
from signalled import stopped
from tiny_run import composed, earlier_export

from col3d.cli.programs import RUNS
from col3d.errors import UserError
from col3d.inference.fusion import fuse as fusing
from col3d.inference.predict import predict
from col3d.phantom import PhantomSettings, render_phantom
from col3d.reports.video import VideoWriter

pytestmark = pytest.mark.end_to_end

SECONDS = 120
CODES = {signal.SIGTERM: 143, signal.SIGINT: 130, signal.SIGHUP: 143}
"""Exit codes; one program is sent them all, the others those below."""
BOTH = (signal.SIGTERM, signal.SIGINT)
FRAMES = 2000


def hidden(folder: Path) -> list[str]:
    """Files that were begun and not finished."""
    return [str(path) for path in folder.rglob("*") if "partial" in path.name]


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("clip") / "clip.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25, (80, 64))
    for number in range(FRAMES):
        writer.write(np.full((64, 80, 3), number % 200, np.uint8))
    writer.release()
    return path


@pytest.mark.parametrize("signum", BOTH)
def test_a_prediction_that_is_stopped_is_whole_as_far_as_it_goes(
    signum: int, clip: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    table = out / "predictions.csv"
    code, said, complained = stopped(
        "predict",
        *(f"input={clip}", f"output={out}", "checkpoint=shipped", "accelerator=cpu", "batch_size=1"),
        cwd=tmp_path,
        signum=signum,
        ready=lambda: table.is_file() and table.read_text().count("\n") > 5,
    )
    assert (code, complained) == (CODES[signal.Signals(signum)], "")
    assert "stopped; the same command with overwrite=true predicts all of it" in said
    facts = json.loads((out / "summary.json").read_text())
    with table.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert facts["stopped"]
    assert 5 < facts["frames"] == len(rows) < FRAMES
    assert len(list((out / "frames").iterdir())) == 2 * len(rows)
    capture = cv2.VideoCapture(str(out / "side_by_side.mp4"))
    assert capture.get(cv2.CAP_PROP_FRAME_COUNT) == len(rows)
    assert hidden(out) == []


@pytest.mark.parametrize("signum", CODES)
def test_an_export_that_is_stopped_leaves_nothing(signum: int, tmp_path: Path) -> None:
    code, said, complained = stopped(
        "export",
        *("checkpoint=shipped", "output=model.onnx"),
        cwd=tmp_path,
        signum=signum,
        ready=lambda: any(tmp_path.glob(".model.*")),
    )
    assert (code, complained) == (CODES[signal.Signals(signum)], "")
    assert said.splitlines()[-1] == (
        "stopped; nothing was written to model.onnx, and the same command begins anew"
    )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.parametrize("signum", BOTH)
def test_a_preparation_that_is_stopped_goes_on(signum: int, workers: int, tmp_path: Path) -> None:
    root = tmp_path / "frames"
    given = ("data=phantom", "phantom.size=[64,80]", "phantom.frames_per_video=40", f"data.root={root}")
    code, said, complained = stopped(
        "prepare",
        *(*given, "data.size=[64,80]", f"workers={workers}"),
        cwd=tmp_path,
        signum=signum,
        ready=lambda: any(root.glob(".partial-*/0001_color.png")),
    )
    assert (code, complained) == (CODES[signal.Signals(signum)], "")
    assert said.splitlines()[-1] == "stopped; finished videos stay, and the same command goes on"
    assert hidden(root) == []


@pytest.mark.parametrize("signum", BOTH)
def test_an_evaluation_that_is_stopped_leaves_no_tables(signum: int, tmp_path: Path) -> None:
    given = (
        *("checkpoint=shipped", "accelerator=cpu", "data=phantom", "data/split=custom", "data.test=null"),
        *("data.split.train=[]", "data.split.val=[]", "data.split.test=[cecum_t1_a]", "panels=1"),
        *(
            "keep_predictions=true",
            "phantom.size=[64,80]",
            "phantom.frames_per_video=60",
            f"data.root={tmp_path / 'frames'}",
        ),
        f"output_dir={tmp_path / 'scored'}",
    )
    code, said, complained = stopped(
        "evaluate",
        *given,
        cwd=tmp_path,
        signum=signum,
        ready=lambda: any(tmp_path.rglob("*.npz.partial")),
    )
    assert (code, complained) == (CODES[signal.Signals(signum)], "")
    assert said.splitlines()[-1] == "stopped; the same command begins again, and nothing of before was lost"
    assert hidden(tmp_path) == []
    assert not list(tmp_path.rglob("*.partial"))
    assert not list(tmp_path.rglob("summary.json"))


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.parametrize("signum", BOTH)
def test_a_verification_that_is_stopped_leaves_what_was_there(
    signum: int, workers: int, phantom_root: Path, tmp_path: Path
) -> None:
    root, out = render(phantom_root).parent, tmp_path / "out"
    code, said, complained = stopped(
        "verify",
        *("data=phantom", "phantom.size=[64,80]", "phantom.frames_per_video=3", f"data.root={root}"),
        *(f"output={out}", f"workers={workers}", "data.allow_missing=true"),
        cwd=tmp_path,
        signum=signum,
        ready=signal.SIGHUP,
    )
    assert (code, complained) == (CODES[signal.Signals(signum)], "")
    assert said.splitlines()[-1] == f"stopped; the same command begins anew; nothing new is in {out}"
    assert not out.exists()


@pytest.mark.parametrize("program", ["train.py", *RUNS])
@pytest.mark.parametrize("signum", [signal.SIGINT, signal.SIGTERM])
def test_a_program_that_still_imports_ends_in_a_line(program: str, signum: int, tmp_path: Path) -> None:
    code, said, complained = stopped(program, cwd=tmp_path, signum=signum, ready=signal.SIGTERM)
    assert (code, complained) == (CODES[signal.Signals(signum)], "")
    assert said == "stopped before anything began; the same command goes on\n"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("signum", BOTH)
def test_a_fusion_that_is_stopped_leaves_what_was_there(
    signum: int,
    phantom_root: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def asked(*_: object) -> None:
        os.kill(os.getpid(), signum)
        time.sleep(SECONDS)

    video = render(phantom_root)
    monkeypatch.setattr(fusing, "surface_of", asked)
    with pytest.raises(SystemExit) as ended:
        fusing.fuse(composed("fuse", f"video={video}", f"output={tmp_path / 'fused'}"))
    assert ended.value.code == CODES[signal.Signals(signum)]
    assert capsys.readouterr().out.splitlines()[-1] == (
        f"stopped; the same command begins anew; nothing new is in {tmp_path / 'fused'}"
    )
    assert list(tmp_path.iterdir()) == []


def render(root: Path) -> Path:
    """A video of the phantom."""
    settings = PhantomSettings(size_hw=(64, 80), frames_per_video=3, videos=("desc_t4_a",))
    render_phantom(root.parent / "stopping", settings, workers=1, progress=False)
    return root.parent / "stopping" / "desc_t4_a"


@contextmanager
def full_disk(most: int) -> Iterator[None]:
    """No file can grow beyond so many bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def noise(height: int = 240, width: int = 320, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)


def test_a_disk_that_is_full_for_a_moment_makes_no_video(tmp_path: Path) -> None:
    writer = VideoWriter(tmp_path / "a.mp4", 10.0)
    writer.add(noise())
    with full_disk(1000):
        for seed in range(40):
            writer.add(noise(seed=seed))
    writer.add(noise())
    with refused(OSError, None, " pictures ", "disk full") as raised:
        writer.close()
    assert raised.value.filename == str(tmp_path / "a.mp4")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("capsys")  # what is printed goes to no file, which would be full, too
@pytest.mark.parametrize(("most", "kind"), [(100, ".col3d_prediction"), (2000, "tiff"), (30_000, "mp4")])
def test_a_full_disk_is_said_of_the_file_of_a_prediction(most: int, kind: str, tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    for number in range(4):
        cv2.imwrite(str(tmp_path / "in" / f"{number}.png"), noise(64, 80))
    place = (f"input={tmp_path / 'in'}", f"output={tmp_path / 'out'}", "checkpoint=shipped")
    with full_disk(most), refused(OSError, None) as raised:
        predict(composed("predict", *place, "accelerator=cpu", "video=true", "previews=false"))
    assert raised.value.filename.endswith(kind)
    assert raised.value.errno == errno.EFBIG or "disk full" in str(raised.value)
    assert hidden(tmp_path) == []
    if kind == "mp4":
        facts = json.loads((tmp_path / "out" / "summary.json").read_text())
        assert (facts["frames"], facts["undone"]) == (4, ["side_by_side.mp4"])
        assert not (tmp_path / "out" / "side_by_side.mp4").exists()
        predict(composed("predict", *place, "accelerator=cpu", "video=true", "previews=false"))
        assert (tmp_path / "out" / "side_by_side.mp4").is_file()
        with refused(UserError, None, tmp_path / "out", "overwrite=true"):
            predict(composed("predict", *place, "accelerator=cpu", "video=true", "previews=false"))


@pytest.mark.parametrize("name", ["model.ckpt", "model.pt2", "model.onnx"])
def test_a_full_disk_is_said_of_the_file_of_an_export(name: str, tmp_path: Path) -> None:
    before = earlier_export(tmp_path / name)
    limited = f"ulimit -f 100; exec {shlex.join(command('export'))} checkpoint=shipped"
    answer = subprocess.run(
        ["bash", "-c", f"{limited} overwrite=true output={name}"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (answer.returncode, refusal(answer.stderr).about) == (2, name)
    assert os.strerror(errno.EFBIG) in answer.stderr
    assert (tmp_path / name).read_bytes() == before
    assert len(list(tmp_path.iterdir())) == 1
