"""SILog: the published figure, a twin in numpy, and laws."""

import laws
import numpy as np
import pytest
import torch
from torch import Tensor

from col3d.losses import silog

PREDS, TARGET, MASK = laws.depth_maps(masked=0.3)


def twin(preds: Tensor, target: Tensor, mask: Tensor, focus: float = 0.85, epsilon: float = 0.0) -> float:
    gap = np.log(preds[mask].double().numpy() + epsilon) - np.log(target[mask].double().numpy())
    return float(10 * np.sqrt(np.mean(gap**2) - focus * np.mean(gap) ** 2))


@pytest.mark.parametrize(("name", "epsilon"), [("silog_loss", 0.0), ("silog_loss_eps1e-3", 1e-3)])
def test_published_figures(published, name: str, epsilon: float) -> None:
    figures, maps = published
    found = silog(maps["depth_pred"], maps["depth_gt"], maps["depth_gt"] > 1, log_epsilon=epsilon)
    assert found.item() == pytest.approx(figures[name], rel=1e-6)
    assert abs(figures["silog_loss"] - figures["silog_loss_eps1e-3"]) > 1e-5  # the test can tell them apart


@pytest.mark.parametrize("focus", [0.0, 0.5, 0.85, 1.0])
@pytest.mark.parametrize("epsilon", [0.0, 1e-3, 1.0])
def test_twin(focus: float, epsilon: float) -> None:
    found = silog(PREDS, TARGET, MASK, variance_focus=focus, log_epsilon=epsilon)
    assert found.item() == pytest.approx(twin(PREDS, TARGET, MASK, focus, epsilon), rel=1e-5)


def test_defaults_are_the_papers() -> None:
    assert silog(PREDS, TARGET, MASK) == silog(PREDS, TARGET, MASK, 10.0, 0.85, 0.0)
    assert silog(PREDS, TARGET, MASK, alpha=3.0).item() == pytest.approx(
        0.3 * silog(PREDS, TARGET, MASK).item()
    )


def test_means_are_over_the_pixels_of_the_whole_batch() -> None:
    mask = MASK.clone()
    mask[0, 0, 2:] = False
    both = silog(PREDS, TARGET, mask).item()
    apart = [silog(PREDS[i : i + 1], TARGET[i : i + 1], mask[i : i + 1]).item() for i in range(2)]
    assert both == pytest.approx(twin(PREDS, TARGET, mask), rel=1e-5)
    assert abs(both - sum(apart) / 2) > 1e-2


def test_zero_at_the_truth_with_no_gradient() -> None:
    laws.costs_nothing_at_truth(silog, TARGET, MASK)


@pytest.mark.parametrize("junk", [float("nan"), float("inf"), -float("inf"), 0.0, -3.0])
def test_masked_pixels_are_inert(junk: float) -> None:
    for gradient in laws.masked_is_inert(silog, PREDS, TARGET, MASK, junk):
        assert (gradient[MASK] != 0).all()


def test_nothing_counts() -> None:
    laws.costs_nothing(silog, PREDS, TARGET, torch.zeros_like(MASK))


def test_scale() -> None:
    """Invariant to scale with full variance focus; otherwise a factor k at the truth costs a fixed amount."""
    for factor in (0.25, 3.0):
        plain = silog(PREDS, TARGET, MASK, variance_focus=1.0)
        torch.testing.assert_close(
            silog(factor * PREDS, TARGET, MASK, variance_focus=1.0), plain, rtol=1e-4, atol=0
        )
        found = silog(factor * TARGET, TARGET, MASK).item()
        assert found == pytest.approx(10 * np.sqrt(0.15) * abs(np.log(factor)), rel=1e-4)
        assert silog(factor * TARGET, TARGET, MASK, variance_focus=1.0).item() < 0.05
    torch.testing.assert_close(silog(0.1 * PREDS, 0.1 * TARGET, MASK), silog(PREDS, TARGET, MASK))


@pytest.mark.parametrize("low", [0.0, 1e-30, -1.0])
def test_depth_of_nothing_is_finite(low: float) -> None:
    laws.depth_of_nothing_is_finite(silog, PREDS, TARGET, low)


@pytest.mark.parametrize("dtype", [torch.bfloat16, torch.float16])
def test_half_precision_is_computed_in_float32(dtype: torch.dtype) -> None:
    half = PREDS.to(dtype)
    laws.half_precision_is_close(silog, half, TARGET, MASK, twin(half, TARGET, MASK), rel=1e-5)


def test_gradient_is_that_of_finite_differences() -> None:
    laws.gradient_is_that_of_finite_differences(
        silog, *(maps[:, :, :3, :4] for maps in (PREDS, TARGET, MASK))
    )
