"""A run under overwrite=true that is stopped goes on; the result comes before what decorates it; each start
says what is not as it was; and nothing is trained on nothing."""

import json
import os
import shutil
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from cut_runs import QUICK, PowerCutError, assert_the_same, cut_in, result, status_of, stopped_in
from refusals import refused
from tiny_run import SMALL, TINY, composed

import col3d.training.decorate as decorating
from col3d.errors import UserError
from col3d.evaluation.evaluate import evaluate
from col3d.evaluation.panels import ImagePanels
from col3d.runs import provenance
from col3d.training.train import train

pytestmark = pytest.mark.end_to_end

Compose = Callable[..., dict[str, Any]]


@pytest.fixture
def own_frames(phantom_root: Path, tiny: Compose, tmp_path: Path) -> Path:
    """A copy of the phantom, to be spoiled."""
    train(tiny(*QUICK, f"output_dir={tmp_path / 'renders_it'}"))
    return Path(shutil.copytree(phantom_root, tmp_path / "frames"))


def without_depth(folder: Path, *numbers: int) -> None:
    """Make all depth of some frames, or all, of a video invalid."""
    names = [f"{number:04d}_depth.tiff" for number in numbers] or ["*_depth.tiff"]
    for path in (path for name in names for path in folder.glob(name)):
        depth = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        assert depth is not None
        cv2.imwrite(str(path), np.zeros_like(depth), [cv2.IMWRITE_TIFF_COMPRESSION, 1])


@pytest.mark.parametrize("before", ["finished", "cut off", "other options", "nothing"])
def test_overwrite_applies_once(
    before: str,
    tiny: Compose,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def options(*overrides: str) -> dict[str, Any]:
        return tiny(*QUICK, "trainer.max_epochs=3", *overrides)

    train(options(f"output_dir={tmp_path / 'whole'}"))
    if before == "finished":
        train(options())
    elif before == "other options":
        train(options("seed=7"))
    elif before == "cut off":
        with monkeypatch.context() as patched:
            cut_in(patched, 1)
            with pytest.raises(PowerCutError):
                train(options())
    for epoch, signum in ((1, signal.SIGTERM), (2, signal.SIGUSR1)):
        with monkeypatch.context() as patched:
            stopped_in(patched, "on_train_batch_start", epoch, 1, signum)
            with pytest.raises(SystemExit):
                train(options("overwrite=true"))
        assert status_of(tmp_path / "run")["state"] == "preempted"
    capsys.readouterr()
    train(options("overwrite=true"))
    said = capsys.readouterr().out
    assert "goes on from" in said
    assert "epoch 1/3" not in said
    assert_the_same(tmp_path / "run", tmp_path / "whole")
    assert "finished before" not in said
    train(options("overwrite=true"))
    assert "epoch 1/3" in capsys.readouterr().out  # asked for again, of a run that had finished


def test_a_replacement_that_was_cut_off_brings_no_old_run_back(
    tiny: Compose, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from col3d.io.ownership import Owned

    train(tiny(*QUICK, "overwrite=true"))

    def cut(self: Owned, below: str = "", keep: Any = ()) -> None:
        raise PowerCutError

    with monkeypatch.context() as patched:
        patched.setattr(Owned, "remove", cut)
        with pytest.raises(PowerCutError):
            train(tiny(*QUICK, "overwrite=true"))
    capsys.readouterr()
    train(tiny(*QUICK))
    said = capsys.readouterr().out
    assert "epoch 1/1" in said
    assert "finished before" not in said


def test_a_frame_without_truth_is_drawn_and_ends_no_run(
    tiny: Compose, own_frames: Path, tmp_path: Path
) -> None:
    without_depth(own_frames / "desc_t4_a", 0, 2)
    options = tiny("model=bts", SMALL, f"data.root={own_frames}", "callbacks.panels=4")
    train(options)
    run = tmp_path / "run"
    assert result(run)["undone"] == []
    assert len(list((run / "panels").glob("*.png"))) == 4
    assert len(list((run / "panels").glob("*.npz"))) == 2
    assert (run / "run.html").is_file()


@pytest.mark.parametrize(
    ("module", "name", "undone"),
    [
        (decorating, "measure_cost", "cost"),
        (decorating, "write_run_page", "run.html"),
        (ImagePanels, "draw", "panels"),
    ],
)
def test_what_decorates_a_result_may_fail_and_is_made_again(
    module: Any,
    name: str,
    undone: str,
    tiny: Compose,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    options, run = tiny("model=bts", SMALL), tmp_path / "run"

    def fails(*given: Any, **options: Any) -> None:
        raise IndexError("index -1 is out of bounds")

    with monkeypatch.context() as patched:
        patched.setattr(module, name, fails)
        train(options)
        said = capsys.readouterr().out
        assert f"note: {undone} failed (IndexError: index -1 is out of bounds); the result stands" in said
        assert status_of(run)["state"] == "done"
        assert result(run)["undone"] == [undone]
        assert train(options) == result(run)["best"]["val/abs_rel"]
        assert "finished before" in capsys.readouterr().out
    tables = {n: (run / n).read_bytes() for n in ("per_frame.csv", "metrics.csv")}
    train(options)
    assert result(run)["undone"] == []
    assert json.loads((run / "summary.json").read_text())["cost"]["gflop"] > 0
    assert len(list((run / "panels").glob("*.png"))) == 1
    assert "data:image/png" in (run / "run.html").read_text()
    assert tables == {n: (run / n).read_bytes() for n in tables}
    capsys.readouterr()
    train(options)
    assert "note:" not in capsys.readouterr().out


def test_how_it_is_shown_makes_no_other_run(tiny: Compose, tmp_path: Path) -> None:
    run = tmp_path / "run"
    first = train(tiny(*QUICK))
    weights = (run / "checkpoints" / "best.ckpt").read_bytes()
    shown = ("callbacks.panels=2", "callbacks.predictions=true", "callbacks.checkpoint_minutes=1")
    assert train(tiny("model=bts", SMALL, *shown)) == first
    assert len(list((run / "panels").glob("*.png"))) == 2
    assert (run / "predictions_test" / "index.json").is_file()
    assert train(tiny(*QUICK)) == first
    assert len(list((run / "panels").glob("*.png"))) == 2
    assert (run / "checkpoints" / "best.ckpt").read_bytes() == weights


def test_what_changed_between_two_starts_is_said(
    tiny: Compose,
    own_frames: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    options = tiny(*QUICK, f"data.root={own_frames}", "trainer.max_epochs=2")
    with monkeypatch.context() as patched:
        cut_in(patched, 1)
        with pytest.raises(PowerCutError):
            train(options)
    capsys.readouterr()
    without_depth(own_frames / "cecum_t1_a", 1)
    with monkeypatch.context() as patched:
        patched.setattr("col3d.runs.starts.commit", lambda: "0123456789ab")
        patched.setattr("col3d.runs.starts.versions", lambda: provenance.versions() | {"timm": "0.0.1"})
        train(options)
    said = capsys.readouterr().out
    real = provenance.versions()["timm"]
    assert f"note: since the last start: commit {provenance.commit()} became 0123456789ab" in said
    assert f"note: since the last start: timm {real} became 0.0.1" in said
    assert "note: since the last start: depth of cecum_t1_a (phantom, train) changed" in said
    assert said.count("note:") == 3
    starts = json.loads((tmp_path / "run" / "starts.json").read_text())["starts"]
    assert len(starts) == 2
    assert {"time", "command", "commit", "code", "packages", "plugins", "data"} == set(starts[0])
    changed = json.loads((tmp_path / "run" / "summary.json").read_text())["changed_between_starts"]
    assert len(changed) == 3
    os.utime(own_frames / "desc_t4_a" / "0001_depth.tiff", (1, 1))
    train(options)
    said = capsys.readouterr().out
    assert "note: since this run's last start: depth of desc_t4_a (phantom, test) changed" in said
    assert "finished before" in said


@pytest.mark.parametrize(
    ("video", "part"), [("cecum_t1_a", "train"), ("trans_t1_a", "val"), ("desc_t4_a", "test")]
)
def test_nothing_is_trained_on_nothing(video: str, part: str, own_frames: Path, tmp_path: Path) -> None:
    without_depth(own_frames / video)
    split = {"train": "cecum_t1_a", "val": "trans_t1_a:1-2", "test": "desc_t4_a"}
    overrides = [f"data.split.{name}=[{entry}]" for name, entry in split.items()]
    place = (f"data.root={own_frames}", f"output_dir={tmp_path / 'run'}")
    with refused(UserError, f"data.split.{part}", f" in {own_frames}") as error:
        train(composed("train", *TINY, *QUICK, *place, *overrides))
    assert "\n" not in str(error.value)
    assert not (tmp_path / "run").exists()


def test_nothing_is_scored_on_nothing(own_frames: Path, tiny: Compose, tmp_path: Path) -> None:
    train(tiny(*QUICK, f"data.root={own_frames}"))
    without_depth(own_frames / "desc_t4_a")
    without_depth(own_frames / "trans_t1_a", 2)
    given = [f"checkpoint={tmp_path}/run/checkpoints/best.ckpt", "accelerator=cpu", "panels=0"]
    for protocol in ("standard", "published", "native"):
        with refused(UserError, "data.split.test", "4 frames"):
            evaluate(composed("evaluate", *given, f"protocol={protocol}"))


@pytest.mark.parametrize("span", ["[100,0]", "[50,50]", "[99,1]"])
def test_a_range_without_depths_is_refused(span: str, tiny: Compose, tmp_path: Path) -> None:
    with refused(UserError, "protocol.truth_range", "[low,high]"):
        train(tiny(f"protocol.standard.truth_range={span}"))
    with refused(UserError, "data.split.test", "protocol.truth_range="):
        train(tiny(*QUICK, "protocol.standard.truth_range=[99.5,99.9]"))
    assert not (tmp_path / "run").exists()
