"""Depth metrics: published figures, a twin in numpy, and laws."""

import numpy as np
import pytest
import torch
from torch import Tensor

from col3d.metrics.functional import DEPTH_METRICS, depth_metrics

GENERATOR = torch.Generator().manual_seed(0)
TARGET = torch.rand(3, 1, 13, 17, generator=GENERATOR) * 90 + 1
PREDS = TARGET * (1 + 0.3 * torch.randn(3, 1, 13, 17, generator=GENERATOR)).clamp(0.2, 3)
MASK = torch.rand(3, 1, 13, 17, generator=GENERATOR) > 0.4


def twin(p: np.ndarray, t: np.ndarray) -> dict[str, float]:
    """Eigen et al., section 4.2, of the valid pixels of one frame."""
    logs, worst = np.log(p) - np.log(t), np.maximum(p / t, t / p)
    return {
        "abs_rel": np.mean(np.abs(p - t) / t),
        "sq_rel": np.mean((p - t) ** 2 / t),
        "log10": np.mean(np.abs(np.log10(p) - np.log10(t))),
        "rmse": np.sqrt(np.mean((p - t) ** 2)),
        "rmse_log": np.sqrt(np.mean(logs**2)),
        "silog": 100 * np.std(logs),
        "delta1": np.mean(worst < 1.25),
        "delta2": np.mean(worst < 1.25**2),
        "delta3": np.mean(worst < 1.25**3),
    }


def frame(values: dict[str, Tensor], index: int) -> dict[str, float]:
    return {name: value[index].item() for name, value in values.items()}


def test_published_depth_figures(published) -> None:
    figures, maps = published
    target = maps["depth_gt"]
    found = depth_metrics(maps["depth_pred"], target, (target > 1e-3) & (target < 100))
    names = {f"d{k}": f"delta{k}" for k in (1, 2, 3)}
    for name, figure in figures["depth_metrics"].items():
        assert found[names.get(name, name)].item() == pytest.approx(figure, rel=1e-5)


def test_depth_equals_its_twin() -> None:
    found = depth_metrics(PREDS, TARGET, MASK)
    assert tuple(found) == DEPTH_METRICS
    for i in range(3):
        valid = MASK[i].numpy()
        expected = twin(PREDS[i].numpy().astype(float)[valid], TARGET[i].numpy().astype(float)[valid])
        assert frame(found, i) == pytest.approx(expected, rel=1e-9)


def test_deltas_are_strict_at_their_limits() -> None:
    target = torch.ones(1, 1, 1, 4, dtype=torch.float64)
    preds = torch.tensor([1.25, 1.25 - 1e-9, 0.8 + 1e-9, 1.25**3], dtype=torch.float64).view_as(target)
    found = depth_metrics(preds, target, torch.ones_like(target, dtype=torch.bool))
    assert [found[f"delta{k}"].item() for k in (1, 2, 3)] == [0.5, 0.75, 0.75]


def test_perfect_depth_is_exact() -> None:
    found = depth_metrics(TARGET, TARGET, MASK)
    for name, values in found.items():
        assert (values == float(name.startswith("delta"))).all(), name


def test_depth_shares_are_fractions_and_values_float64() -> None:
    for name, values in depth_metrics(PREDS, TARGET, MASK).items():
        assert values.dtype == torch.float64
        assert values.shape == (3,)
        if name.startswith("delta"):
            assert ((values >= 0) & (values <= 1)).all()


@pytest.mark.parametrize("junk", [float("nan"), float("inf"), 0.0, -5.0])
def test_masked_depth_does_not_count(junk: float) -> None:
    expected = depth_metrics(PREDS, TARGET, MASK)
    found = depth_metrics(torch.where(MASK, PREDS, junk), torch.where(MASK, TARGET, junk), MASK)
    for name in DEPTH_METRICS:
        assert torch.equal(found[name], expected[name])


def test_frames_do_not_see_each_other() -> None:
    found = depth_metrics(PREDS, TARGET, MASK)
    for i in range(3):
        alone = depth_metrics(PREDS[i : i + 1], TARGET[i : i + 1], MASK[i : i + 1])
        assert frame(alone, 0) == pytest.approx(frame(found, i), rel=1e-12)


def test_an_empty_frame_has_no_depth_values() -> None:
    mask = MASK.clone()
    mask[1] = False
    for values in depth_metrics(PREDS, TARGET, mask).values():
        assert values.isnan().tolist() == [False, True, False]


@pytest.mark.parametrize(("low", "high"), [(0.0, 500.0), (-3.0, float("inf"))])
def test_predictions_are_cut_to_the_range(low: float, high: float) -> None:
    preds = PREDS.clone()
    preds[:, :, 0], preds[:, :, 1] = low, high
    found = depth_metrics(preds, TARGET, MASK, min_depth=0.5, max_depth=100.0)
    expected = depth_metrics(preds.clamp(0.5, 100.0), TARGET, MASK)
    for name in DEPTH_METRICS:
        assert torch.equal(found[name], expected[name])
        assert found[name].isfinite().all()


def test_units() -> None:
    """In other units of length, only the metrics in mm change."""
    found, metres = depth_metrics(PREDS, TARGET, MASK), depth_metrics(PREDS / 8, TARGET / 8, MASK)
    for name in DEPTH_METRICS:
        factor = 8 if name in ("sq_rel", "rmse") else 1
        torch.testing.assert_close(factor * metres[name], found[name], rtol=1e-6, atol=0)
