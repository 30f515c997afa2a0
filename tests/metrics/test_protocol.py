"""Protocols: what they fit away, what they mix in, and the published figures."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from refusals import refused
from torch import Tensor

from col3d.batch import Batch
from col3d.metrics import Protocol
from col3d.metrics.alignment import FITS, alignment
from col3d.metrics.functional import depth_metrics, normal_metrics

PUBLISHED = Protocol("published", truth_range=(1e-3, 100.0), cosine_epsilon=1e-3, normal_axes="published")


@pytest.fixture
def batch() -> Batch:
    torch.manual_seed(0)
    depth = 1 + 80 * torch.rand(3, 1, 20, 30)
    normals = torch.nn.functional.normalize(torch.randn(3, 3, 20, 30), dim=1)
    mask = torch.rand(3, 1, 20, 30) > 0.2
    found: Any = {"depth": depth, "normals": normals, "mask": mask}
    return found  # type: ignore[no-any-return]


def test_the_standard_is_the_plain_metrics(batch: Batch) -> None:
    guess, normals = batch["depth"] * 1.2 + 1, batch["normals"].roll(1, dims=1)
    values = Protocol().score({"depth": guess, "normals": normals}, batch)
    expected = depth_metrics(guess, batch["depth"], batch["mask"])
    expected |= normal_metrics(normals, batch["normals"], batch["mask"])
    assert all(torch.equal(values[name], value) for name, value in expected.items())
    assert values["pixels"].tolist() == batch["mask"].sum(dim=(1, 2, 3)).tolist()
    strict = (torch.maximum(guess / batch["depth"], batch["depth"] / guess) < 1.1)[batch["mask"]]
    assert (values["delta_1_1"] * values["pixels"]).sum().item() == pytest.approx(strict.sum().item())


@pytest.mark.parametrize(
    ("scaling", "shift"), [("median", 0.0), ("scale_and_shift", 0.0), ("scale_and_shift", 3)]
)
def test_what_is_fitted_does_not_count(batch: Batch, scaling: str, shift: float) -> None:
    factors = torch.tensor([0.3, 1.0, 1.1])[:, None, None, None]
    guess = torch.where(batch["mask"], batch["depth"] * factors + shift, torch.nan)
    values = Protocol(scaling=scaling).score({"depth": guess}, batch)
    assert values["abs_rel"].max() < 1e-6


def test_fits_are_those_of_numpy(batch: Batch) -> None:
    guess = 5 + 60 * torch.rand(3, 1, 20, 30)
    for i in range(3):
        counts = batch["mask"][i].numpy()
        p, t = guess[i].double().numpy()[counts], batch["depth"][i].double().numpy()[counts]
        slope, offset = np.polyfit(p, t, 1)
        for name, expected in (
            ("median", p * (np.median(t) / np.median(p))),
            ("scale_and_shift", slope * p + offset),
        ):
            pair = torch.from_numpy(p).double(), torch.from_numpy(t).double()
            found = alignment(name, "depth", [pair])(pair[0]).numpy()
            np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_a_frame_that_nothing_counts_of_has_no_metrics(batch: Batch) -> None:
    batch["mask"][1] = False
    for scaling in FITS:
        values = Protocol(scaling=scaling).score({"depth": batch["depth"] * 2}, batch)
        assert values["pixels"][1] == 0
        assert values["abs_rel"].isnan().tolist() == [False, True, False]


def test_the_published_figures(published: tuple[dict[str, Any], dict[str, Tensor]]) -> None:
    figures, maps = published
    batch: Any = {"depth": maps["depth_gt"], "normals": maps["normal_gt"], "mask": maps["depth_gt"] > -1}
    prediction: Any = {"depth": maps["depth_pred"], "normals": maps["normal_pred"]}
    values = replace(PUBLISHED, normal_axes="standard").score(prediction, batch)
    for name, expected in figures["depth_metrics"].items():
        assert values[name.replace("d", "delta") if name[0] == "d" else name].item() == pytest.approx(
            expected
        )
    assert values["angle_mean"].item() == pytest.approx(figures["normal_metrics"]["mean_ang"], rel=1e-6)
    assert 100 * values["within_30"].item() == pytest.approx(figures["normal_metrics"]["d30"])


def test_published_axes_are_another_way_to_say_the_same_but_for_what_they_cut(batch: Batch) -> None:
    prediction: Any = {"depth": batch["depth"], "normals": batch["normals"].roll(1, dims=1)}
    batch["normals"][:, 2] = -batch["normals"][:, 2].abs()
    standard, published = replace(PUBLISHED, normal_axes="standard"), PUBLISHED
    torch.testing.assert_close(
        published.score(prediction, batch)["angle_mean"], standard.score(prediction, batch)["angle_mean"]
    )
    batch["normals"][:, 2] *= -1
    cut = published.score({**prediction, "normals": batch["normals"]}, batch)["angle_mean"]
    assert (cut > 20).all()


def test_a_prediction_is_brought_to_the_size_of_the_truth(batch: Batch) -> None:
    flat = torch.full((3, 1, 10, 15), 20.0)
    values = Protocol().score({"depth": flat}, batch)
    expected = depth_metrics(torch.full_like(batch["depth"], 20.0), batch["depth"], batch["mask"])
    torch.testing.assert_close(values["abs_rel"], expected["abs_rel"])


def test_true_depths_outside_the_range_do_not_count(batch: Batch) -> None:
    values = Protocol(truth_range=(10.0, 50.0)).score({"depth": batch["depth"]}, batch)
    inside = batch["mask"] & (batch["depth"] > 10) & (batch["depth"] < 50)
    assert values["pixels"].tolist() == inside.sum(dim=(1, 2, 3)).tolist()


@pytest.mark.parametrize("wrong", [{"scaling": "mean"}, {"normal_axes": "opengl"}])
def test_unknown_words(wrong: dict[str, str]) -> None:
    with refused(ValueError, f"protocol.{next(iter(wrong))}", *map(repr, wrong.values())):
        Protocol(**wrong)
