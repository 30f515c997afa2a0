"""Mean absolute error and RMSE of logarithms: twins in numpy, and laws."""

import inspect
import math

import laws
import numpy as np
import pytest
import torch
from refusals import refused
from torch import Tensor

from col3d.losses.depth import silog
from col3d.losses.depth_regression import depth_l1, rmse_log

PREDS, TARGET, MASK = laws.depth_maps(masked=0.3)


def l1_twin(preds: np.ndarray, target: np.ndarray) -> float:
    return float(np.abs(preds - target).mean())


def log_twin(preds: np.ndarray, target: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.log(preds / target) ** 2)))


LOSSES = [(depth_l1, l1_twin), (rmse_log, log_twin)]
both = pytest.mark.parametrize(("loss", "twin"), LOSSES, ids=["l1", "rmse_log"])


def counted(values: Tensor, mask: Tensor) -> np.ndarray:
    found: np.ndarray = values[mask].double().numpy()
    return found


@both
def test_depth_loss_equals_its_twin(loss, twin) -> None:
    expected = twin(counted(PREDS, MASK), counted(TARGET, MASK))
    assert loss(PREDS, TARGET, MASK).item() == pytest.approx(expected, rel=1e-6)
    assert loss(PREDS.double(), TARGET.double(), MASK).item() == pytest.approx(expected, rel=1e-12)


@both
def test_the_true_depth_costs_nothing(loss, twin) -> None:
    laws.costs_nothing_at_truth(loss, TARGET, MASK)


@both
@pytest.mark.parametrize("junk", [float("nan"), float("inf"), -float("inf"), 0.0, -3.0])
def test_masked_depth_is_inert(loss, twin, junk: float) -> None:
    for gradient in laws.masked_is_inert(loss, PREDS, TARGET, MASK, junk):
        assert (gradient[MASK] != 0).all()


@both
def test_no_depth_counts(loss, twin) -> None:
    laws.costs_nothing(loss, PREDS, TARGET, torch.zeros_like(MASK))


@both
@pytest.mark.parametrize("dtype", [torch.bfloat16, torch.float16])
def test_half_precision_depth(loss, twin, dtype: torch.dtype) -> None:
    half = PREDS.to(dtype)
    expected = twin(counted(half, MASK), counted(TARGET, MASK))
    laws.half_precision_is_close(loss, half, TARGET, MASK, expected, rel=1e-5)


@both
def test_gradient_of_depth_losses(loss, twin) -> None:
    laws.gradient_is_that_of_finite_differences(loss, *(maps[:, :, :3, :4] for maps in (PREDS, TARGET, MASK)))


@both
def test_depth_that_is_no_number_gives_a_loss_that_is_none(loss, twin) -> None:
    bad = PREDS.clone()
    bad[MASK.nonzero()[0].split(1)] = float("nan")
    assert loss(bad, TARGET, MASK).isnan()


def test_depth_of_other_shapes_is_refused() -> None:
    unchecked = inspect.unwrap(depth_l1)  # as it is outside of tests, where shapes are no types
    with refused(ValueError, "preds, target", tuple(PREDS.shape), tuple(TARGET[:1].shape)):
        unchecked(PREDS, TARGET[:1], MASK)


def test_l1_is_in_mm() -> None:
    assert depth_l1(TARGET + 3, TARGET, MASK).item() == pytest.approx(3, rel=1e-5)
    assert depth_l1(TARGET - 3, TARGET, MASK).item() == pytest.approx(3, rel=1e-5)
    torch.testing.assert_close(depth_l1(0.1 * PREDS, 0.1 * TARGET, MASK), 0.1 * depth_l1(PREDS, TARGET, MASK))


def test_l1_of_depth_in_the_published_range() -> None:
    signed = [2 * depth / 100 - 1 for depth in (PREDS, TARGET)]
    torch.testing.assert_close(depth_l1(*signed, MASK), 2 / 100 * depth_l1(PREDS, TARGET, MASK))


@pytest.mark.parametrize("factor", [0.25, 3.0])
def test_a_factor_costs_its_logarithm(factor: float) -> None:
    assert rmse_log(factor * TARGET, TARGET, MASK).item() == pytest.approx(abs(math.log(factor)), rel=1e-5)
    torch.testing.assert_close(rmse_log(factor * PREDS, factor * TARGET, MASK), rmse_log(PREDS, TARGET, MASK))
    torch.testing.assert_close(rmse_log(TARGET, PREDS, MASK), rmse_log(PREDS, TARGET, MASK))


def test_rmse_log_is_never_below_its_scale_invariant_part() -> None:
    invariant = silog(PREDS, TARGET, MASK, alpha=1.0, variance_focus=1.0)
    assert rmse_log(PREDS, TARGET, MASK) >= invariant


@pytest.mark.parametrize("low", [0.0, 1e-30, -1.0])
def test_logarithm_of_nothing_is_finite(low: float) -> None:
    laws.depth_of_nothing_is_finite(rmse_log, PREDS, TARGET, low)
