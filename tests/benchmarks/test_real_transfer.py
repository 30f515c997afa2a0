"""The table of transfer: nothing for the truth, and the medians' ratio for a constant."""

import pytest
import torch

from benchmarks.transfer import BASELINES, SIZE, constant, guessed, scales, scores
from col3d.data.datasets.c3vd import C3VD
from col3d.data.sized import Resized
from col3d.phantom import PhantomSettings, phantom_camera, render_phantom


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> Resized:
    root = tmp_path_factory.mktemp("transfer") / "phantom"
    settings = PhantomSettings((135, 169), 1, videos=("cecum_t1_a",))
    render_phantom(root, settings, workers=1, progress=False)
    return Resized(C3VD(root, ["cecum_t1_a"], normals="none", camera=phantom_camera(settings)), SIZE)


def test_the_truth_has_no_error(frames: Resized) -> None:
    depth = frames[0]["depth"][None].clamp(min=1.0)
    exact, larger = guessed(frames, lambda _: depth), guessed(frames, lambda _: 3 * depth)
    assert scores(exact, "none") == {"abs_rel": 0.0, "rmse": 0.0, "delta1": 1.0}
    assert scores(larger, "median")["abs_rel"] == pytest.approx(0, abs=1e-6)
    assert scales(larger) == pytest.approx([3.0])


def test_a_constant_is_brought_to_the_median(frames: Resized) -> None:
    depth = frames[0]["depth"][0][frames[0]["mask"][0]].double()
    expected = ((depth.quantile(0.5) - depth).abs() / depth).mean()
    assert scores(guessed(frames, constant), "median")["abs_rel"] == pytest.approx(float(expected), rel=1e-4)


@pytest.mark.parametrize("name", BASELINES)
def test_baselines_are_positive_and_of_the_image_size(name: str) -> None:
    guess = BASELINES[name](torch.rand(1, 3, 32, 40))
    assert guess.shape == (1, 1, 32, 40)
    assert (guess > 0).all()
