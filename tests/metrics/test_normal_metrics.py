"""Metrics of normals: published figures, a twin in numpy, and laws."""

import math

import numpy as np
import pytest
import torch
from torch.nn.functional import normalize

from col3d.metrics.functional import NORMAL_METRICS, normal_metrics

GENERATOR = torch.Generator().manual_seed(0)
TARGET = normalize(torch.randn(3, 3, 13, 17, generator=GENERATOR), dim=1)
PREDS = TARGET + 0.3 * torch.randn(3, 3, 13, 17, generator=GENERATOR)
MASK = torch.rand(3, 1, 13, 17, generator=GENERATOR) > 0.4
OF_PERFECT = math.degrees(math.acos(1 / 1.001))
"""2.56 degrees: what the published epsilon makes of a perfect prediction."""


def twin(p: np.ndarray, t: np.ndarray) -> dict[str, float]:
    """Of the valid normals (n, 3) of one frame."""
    cosine = np.sum(p * t, axis=1) / np.linalg.norm(p, axis=1) / np.linalg.norm(t, axis=1)
    angles = np.degrees(np.arccos(cosine.clip(-1, 1)))
    return {
        "angle_mean": np.mean(angles),
        "angle_median": np.median(angles),
        "within_11_25": np.mean(angles < 11.25),
        "within_22_5": np.mean(angles < 22.5),
        "within_30": np.mean(angles < 30),
    }


def test_published_normal_figures(published) -> None:
    figures, maps = published
    mask = (maps["depth_gt"] > 1e-3) & (maps["depth_gt"] < 100)
    found = normal_metrics(maps["normal_pred"], maps["normal_gt"], mask, cosine_epsilon=1e-3)
    names = ("mean_ang", "median_ang", "d11.25", "d22.5", "d30")
    for name, published_name in zip(NORMAL_METRICS, names, strict=True):
        percent = 100 if name.startswith("within") else 1
        figure = figures["normal_metrics"][published_name]
        # the published median is one of the two middle values of an even count
        assert percent * found[name].item() == pytest.approx(figure, rel=1e-3 if "median" in name else 1e-5)


@pytest.mark.parametrize("parity", [0, 1])
def test_normals_equal_their_twin(parity: int) -> None:
    """Frames with an even and an odd number of pixels: the median of either."""
    mask = MASK.clone()
    for one in mask:
        if int(one.sum()) % 2 != parity:
            one[0].view(-1)[int(one.view(-1).nonzero()[0])] = False
        assert int(one.sum()) % 2 == parity
    found = normal_metrics(PREDS, TARGET, mask)
    assert tuple(found) == NORMAL_METRICS
    for i in range(3):
        valid = mask[i, 0].numpy()
        p, t = (n[i].permute(1, 2, 0).double().numpy()[valid] for n in (PREDS, TARGET))
        assert {k: v[i].item() for k, v in found.items()} == pytest.approx(twin(p, t), abs=1e-4)


def test_median_of_two_is_their_mean() -> None:
    turned = [[1.0, 0.0, 0.0], [math.cos(0.5), math.sin(0.5), 0.0]]
    preds = torch.tensor(turned).T.view(1, 3, 1, 2)
    target = torch.tensor([1.0, 0.0, 0.0]).view(1, 3, 1, 1).expand(1, 3, 1, 2)
    found = normal_metrics(preds, target, torch.ones(1, 1, 1, 2, dtype=torch.bool))
    assert found["angle_median"].item() == pytest.approx(math.degrees(0.25), rel=1e-6)


def test_perfect_normals_are_exact() -> None:
    for name, values in normal_metrics(TARGET, TARGET, MASK).items():
        assert (values == float(name.startswith("within"))).all(), name


def test_published_epsilon_costs_a_perfect_prediction() -> None:
    found = normal_metrics(TARGET, TARGET, MASK, cosine_epsilon=1e-3)
    assert pytest.approx(2.56, abs=5e-3) == OF_PERFECT
    for name in ("angle_mean", "angle_median"):
        torch.testing.assert_close(found[name], torch.full((3,), OF_PERFECT).double(), atol=2e-3, rtol=0)


def test_opposite_normals() -> None:
    found = normal_metrics(-TARGET, TARGET, MASK)
    assert (found["angle_mean"] == 180).all()
    assert (found["within_30"] == 0).all()


def test_lengths_are_of_no_matter_without_the_epsilon() -> None:
    lengths = torch.rand(3, 1, 13, 17, generator=torch.Generator().manual_seed(1)) * 9 + 0.1
    found, expected = normal_metrics(PREDS * lengths, TARGET, MASK), normal_metrics(PREDS, TARGET, MASK)
    for name in NORMAL_METRICS:
        torch.testing.assert_close(found[name], expected[name], atol=1e-4, rtol=0)


@pytest.mark.parametrize("epsilon", [0.0, 1e-3])
@pytest.mark.parametrize("junk", [float("nan"), float("inf"), 0.0])
def test_masked_normals_do_not_count(junk: float, epsilon: float) -> None:
    expected = normal_metrics(PREDS, TARGET, MASK, epsilon)
    found = normal_metrics(torch.where(MASK, PREDS, junk), torch.where(MASK, TARGET, junk), MASK, epsilon)
    for name in NORMAL_METRICS:
        assert torch.equal(found[name], expected[name])


def test_an_empty_frame_has_no_normal_values() -> None:
    mask = MASK.clone()
    mask[1] = False
    for values in normal_metrics(PREDS, TARGET, mask).values():
        assert values.dtype == torch.float64
        assert values.isnan().tolist() == [False, True, False]
