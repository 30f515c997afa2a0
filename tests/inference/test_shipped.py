"""The network that comes with the package: what it weighs, tells and is worth; and files of weights alone."""

from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
import torch
from programs import call
from refusals import refused
from tiny_run import composed, real_frames

from benchmarks.transfer import SIZE, Guessed, guessed, network, scores
from col3d.data.datasets.c3vd import C3VD
from col3d.data.sized import Resized
from col3d.errors import UserError
from col3d.inference.export.export import export
from col3d.inference.predictor import load_predictor
from col3d.inference.trained_network import SHIPPED
from col3d.phantom import PARTS, PhantomSettings, phantom_camera, render_phantom

pytestmark = pytest.mark.end_to_end

LARGEST = 3_000_000
"""Bytes."""


def shipped_on(frames: Resized) -> list[Guessed]:
    return guessed(frames, network(Path(SHIPPED)))


def test_it_is_small_and_of_no_machine() -> None:
    content = files("col3d.weights").joinpath("shipped.ckpt").read_bytes()
    assert len(content) <= LARGEST
    for word in (b"/work/", b"/home/", b"/root/", b"/tmp/"):
        assert word not in content


def test_it_knows_the_lens_and_says_what_it_was_trained_on() -> None:
    shipped = load_predictor(Path(SHIPPED))
    assert shipped.trained_on == ("phantom",)
    assert shipped.knows(phantom_camera(PhantomSettings(SIZE)))


def test_it_reads_colons_that_it_has_not_seen(tmp_path: Path) -> None:
    videos = tuple(f"{video}_s90" for video in ("cecum_t1_a", "trans_t2_a", "desc_t4_a", "sigmoid_t3_a"))
    settings = PhantomSettings((135, 169), 3, randomise=PARTS, videos=videos)
    render_phantom(tmp_path / "phantom", settings, workers=1, progress=False)
    camera = phantom_camera(settings)
    frames = Resized(C3VD(tmp_path / "phantom", videos, normals="none", camera=camera), SIZE)
    found = scores(shipped_on(frames), "median")
    assert found["abs_rel"] < 0.25


@pytest.mark.parametrize(
    ("video", "abs_rel", "delta1", "unscaled"),
    [("cecum_t1_a", 0.099, 0.943, 0.145), ("unknown_frame", 0.127, 0.900, 0.231)],
)
def test_it_reads_real_frames_as_well_as_the_page_says(
    video: str, abs_rel: float, delta1: float, unscaled: float
) -> None:
    frames = Resized(C3VD(real_frames("sample_current"), [video], normals="none"), SIZE)
    said = shipped_on(frames)
    scaled, plain = (scores(said, scaling) for scaling in ("median", "none"))
    assert scaled["abs_rel"] == pytest.approx(abs_rel, abs=2e-3)
    assert scaled["delta1"] == pytest.approx(delta1, abs=5e-3)
    assert plain["abs_rel"] == pytest.approx(unscaled, abs=4e-3)


def test_predict_needs_no_checkpoint(phantom_root: Path, tmp_path: Path) -> None:
    settings = PhantomSettings((135, 169), 2, videos=("cecum_t1_a",))
    render_phantom(tmp_path / "phantom", settings, workers=1, progress=False)
    image = tmp_path / "phantom" / "cecum_t1_a" / "0001_color.png"
    answer = call("predict", f"input={image}", "output=found", "camera=c3vd", cwd=tmp_path)
    assert (answer.returncode, answer.stderr) == (0, "")
    assert list((tmp_path / "found").rglob("*depth*"))


def test_a_network_alone_says_what_its_checkpoint_says(tiny_checkpoint: Path, tmp_path: Path) -> None:
    path = tmp_path / "alone.ckpt"
    export(composed("export", f"checkpoint={tiny_checkpoint}", f"output={path}"))
    assert path.stat().st_size < 0.4 * tiny_checkpoint.stat().st_size
    image = torch.from_numpy(np.random.default_rng(0).integers(0, 255, (1, 3, 64, 80), np.uint8))
    whole, alone = load_predictor(tiny_checkpoint), load_predictor(path)
    assert (alone.name, alone.size_hw, alone.trained_on) == (whole.name, whole.size_hw, whole.trained_on)
    expected, found = whole.predict(image)["depth"], alone.predict(image)["depth"]
    assert 0 < ((found - expected) / expected).abs().max() < 0.02


def test_published_weights_are_not_written_as_ours(tmp_path: Path) -> None:
    with refused(UserError, "output", "train.py", "published=bts"):
        export(composed("export", "checkpoint=x", "published=bts", f"output={tmp_path / 'a.ckpt'}"))


def test_a_checkpoint_is_not_replaced_by_its_network(tiny_checkpoint: Path) -> None:
    given = composed("export", f"checkpoint={tiny_checkpoint}", f"output={tiny_checkpoint}", "overwrite=true")
    before = tiny_checkpoint.read_bytes()
    with refused(UserError, "output", f"{tiny_checkpoint} is the checkpoint"):
        export(given)
    assert tiny_checkpoint.read_bytes() == before


def test_what_is_shipped_is_not_of_others() -> None:
    with refused(UserError, "checkpoint", "published=monodepth_fpn"):
        load_predictor(Path(SHIPPED), published="monodepth_fpn")


def test_it_is_evaluated_like_any_other(tmp_path: Path) -> None:
    split = "data.split.test=[cecum_t1_a,trans_t1_a_s5]"
    options = ("checkpoint=shipped", "data=phantom", "phantom=smoke", "data/split=custom", split, "panels=0")
    answer = call("evaluate", *options, f"data.root={tmp_path / 'phantom'}", "workers=0", cwd=tmp_path)
    assert answer.returncode == 0, answer.stderr
    folder = tmp_path / "runs" / "shipped" / "evaluation_shipped_phantom_custom_test"
    assert (folder / "summary.json").is_file()
