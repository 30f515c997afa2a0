"""MAE, ranges of depth and the further metrics of normals: twins in numpy, laws, and published figures."""

from itertools import pairwise

import numpy as np
import pytest
import torch
from parity import needs_parity

from col3d.metrics.functional import NORMAL_METRICS, boundary_f1, depth_metrics, normal_metrics
from col3d.metrics.functional.depth import depth_errors
from col3d.metrics.functional.normals import normal_errors
from col3d.metrics.functional.ranges import range_errors
from col3d.metrics.measure import measure
from col3d.registry.metric_specs import RANGES

GENERATOR = torch.Generator().manual_seed(0)
TARGET = torch.rand(3, 1, 13, 17, generator=GENERATOR) * 90 + 1
PREDS = TARGET * (1 + 0.3 * torch.randn(3, 1, 13, 17, generator=GENERATOR)).clamp(0.2, 3)
MASK = torch.rand(3, 1, 13, 17, generator=GENERATOR) > 0.4
TRUE_NORMALS, NORMALS = (
    torch.nn.functional.normalize(
        torch.tensor([0.0, 0.0, -3.0])[:, None, None] + torch.randn(3, 3, 13, 17, generator=GENERATOR), dim=1
    )
    for _ in range(2)
)
THEIRS = {"mae": "mae", "rmse": "rmse", "abs_rel": "absrel", "delta1": "d1"}
"""What EndoStreamDepth calls metrics of a range."""


def test_mae_equals_its_twin_and_changes_no_other() -> None:
    found = depth_errors(PREDS, TARGET, MASK)
    for i in range(3):
        gap = (PREDS[i].double() - TARGET[i].double()).abs()[MASK[i]].numpy()
        assert found["mae"][i].item() == pytest.approx(gap.mean(), rel=1e-12)
    assert all(torch.equal(found[name], value) for name, value in depth_metrics(PREDS, TARGET, MASK).items())
    assert (found["mae"] <= found["rmse"]).all()


def test_ranges_are_the_metrics_of_their_pixels() -> None:
    """Those of the whole under a smaller mask, which another function computes."""
    found = range_errors(PREDS, TARGET, MASK, 1e-3, 100.0)
    for part, (low, high) in RANGES.items():
        inside = MASK & (low <= TARGET) & (high > TARGET)
        expected = depth_errors(PREDS, TARGET, inside, 1e-3, 100.0)
        for name in THEIRS:
            torch.testing.assert_close(found[f"{part}_{name}"], expected[name], rtol=1e-12, atol=0)


@pytest.mark.parametrize(
    ("depth", "part"), [(29.99, "near"), (30.0, "mid"), (69.99, "mid"), (70.0, "far"), (99.0, "far")]
)
def test_limits_of_ranges(depth: float, part: str) -> None:
    target = torch.full((1, 1, 4, 5), depth)
    found = range_errors(target + 1.5, target, torch.ones_like(target, dtype=torch.bool))
    assert {name for name, value in found.items() if not value.isnan()} == {f"{part}_{n}" for n in THEIRS}
    assert found[f"{part}_mae"].item() == pytest.approx(1.5, rel=1e-5)


def test_ranges_share_the_pixels_among_them() -> None:
    counts = {p: (MASK & (a <= TARGET) & (b > TARGET)).sum(dim=(1, 2, 3)) for p, (a, b) in RANGES.items()}
    found = range_errors(PREDS, TARGET, MASK)
    whole = sum(found[f"{part}_mae"].nan_to_num() * count for part, count in counts.items())
    torch.testing.assert_close(
        whole / MASK.sum(dim=(1, 2, 3)), depth_errors(PREDS, TARGET, MASK)["mae"], rtol=1e-12, atol=0
    )


def test_further_metrics_of_normals_equal_their_twin() -> None:
    found = normal_errors(NORMALS, TRUE_NORMALS, MASK)
    for i in range(3):
        p, t = (x[i].double().numpy()[:, MASK[i, 0].numpy()] for x in (NORMALS, TRUE_NORMALS))
        angles = np.degrees(np.arctan2(np.linalg.norm(np.cross(p, t, axis=0), axis=0), (p * t).sum(axis=0)))
        assert found["angle_rmse"][i].item() == pytest.approx(np.sqrt(np.mean(angles**2)), rel=1e-5)
        assert found["within_5"][i].item() == np.mean(angles < 5)
        assert found["within_7_5"][i].item() == np.mean(angles < 7.5)
    plain = normal_metrics(NORMALS, TRUE_NORMALS, MASK)
    assert tuple(plain) == NORMAL_METRICS
    assert all(torch.equal(found[name], value) for name, value in plain.items())


def test_shares_grow_with_their_limit_and_the_mean_is_below_the_root_of_squares() -> None:
    found = normal_errors(NORMALS, TRUE_NORMALS, MASK)
    shares = [found[f"within_{limit}"] for limit in ("5", "7_5", "11_25", "22_5", "30")]
    assert all((less <= more).all() for less, more in pairwise(shares))
    assert (found["angle_mean"] <= found["angle_rmse"]).all()


@needs_parity
def test_figures_of_endostreamdepth(literature) -> None:
    figures, pred, truth = literature
    found = measure("depth", pred, truth, truth > 0, max_depth=100.0)
    compared = 0
    for i, theirs in enumerate(figures["endostreamdepth"]["per_frame"]):
        assert found["mae"][i].item() == pytest.approx(theirs["mae"], rel=1e-6)
        for part in RANGES:
            for name, theirs_name in THEIRS.items():
                ours, figure = found[f"{part}_{name}"][i].item(), theirs[f"{theirs_name}_{part}"]
                compared += 1
                if figure is None:
                    assert np.isnan(ours)
                else:
                    assert ours == pytest.approx(figure, rel=1e-6)
    assert compared == 7 * 12


@needs_parity
def test_figures_of_the_boundary_f1(literature) -> None:
    figures, pred, truth = literature
    filled = torch.where(truth > 0, truth, 50.0)
    found = boundary_f1(pred, filled, torch.ones_like(truth, dtype=torch.bool))
    assert found.tolist() == pytest.approx(figures["boundary_f1"], rel=1e-9)
