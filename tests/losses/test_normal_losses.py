"""Errors of normals, and cross-task consistency: published figures, twins and laws."""

import laws
import numpy as np
import pytest
import torch
from torch import Tensor
from torch.nn.functional import normalize

from col3d.losses import cross_task_l1, cross_task_rmse, normal_l1, normal_rmse

GENERATOR = torch.Generator().manual_seed(0)
PREDS = normalize(torch.randn(2, 3, 13, 17, generator=GENERATOR), dim=1)
TARGET = normalize(torch.randn(2, 3, 13, 17, generator=GENERATOR), dim=1)
MASK = torch.rand(2, 1, 13, 17, generator=GENERATOR) > 0.3
LOSSES = {
    "l1": (normal_l1, lambda gap: np.abs(gap).mean()),
    "rmse": (normal_rmse, lambda gap: np.sqrt((gap**2).mean())),
    "x-tc l1": (cross_task_l1, lambda gap: np.abs(gap).mean()),
    "x-tc rmse": (cross_task_rmse, lambda gap: np.sqrt((gap**2).mean())),
}


def gap_twin(preds: Tensor, target: Tensor, mask: Tensor) -> np.ndarray:
    gap: np.ndarray = (preds.double() - target.double()).permute(0, 2, 3, 1)[mask[:, 0]].numpy()
    return gap


@pytest.mark.parametrize(("figure", "loss"), [("normal_l1", normal_l1), ("normal_rmse", normal_rmse)])
def test_published_figures(published, figure: str, loss) -> None:
    figures, maps = published
    found = loss(maps["normal_pred"], maps["normal_gt"], maps["depth_gt"] > 1)
    assert found.item() == pytest.approx(figures[figure], rel=1e-5)


@pytest.mark.parametrize("name", LOSSES)
def test_loss_equals_its_twin(name: str) -> None:
    loss, twin = LOSSES[name]
    assert loss(PREDS, TARGET, MASK).item() == pytest.approx(twin(gap_twin(PREDS, TARGET, MASK)), rel=1e-6)


@pytest.mark.parametrize("name", LOSSES)
def test_normals_of_the_truth_cost_nothing(name: str) -> None:
    laws.costs_nothing_at_truth(LOSSES[name][0], TARGET, MASK)


@pytest.mark.parametrize("name", LOSSES)
@pytest.mark.parametrize("junk", [float("nan"), float("inf"), 5.0])
def test_masked_normals_are_inert(name: str, junk: float) -> None:
    for gradient in laws.masked_is_inert(LOSSES[name][0], PREDS, TARGET, MASK, junk):
        assert (gradient[MASK.expand_as(PREDS)] != 0).all()


@pytest.mark.parametrize("name", LOSSES)
def test_no_normal_counts(name: str) -> None:
    laws.costs_nothing(LOSSES[name][0], PREDS, TARGET, torch.zeros_like(MASK))


@pytest.mark.parametrize("name", LOSSES)
@pytest.mark.parametrize("dtype", [torch.bfloat16, torch.float16])
def test_half_precision_normals(name: str, dtype: torch.dtype) -> None:
    loss, twin = LOSSES[name]
    half = PREDS.to(dtype)
    laws.half_precision_is_close(loss, half, TARGET, MASK, twin(gap_twin(half, TARGET, MASK)), rel=1e-5)


@pytest.mark.parametrize(("cross", "plain"), [(cross_task_l1, normal_l1), (cross_task_rmse, normal_rmse)])
def test_consistency_leaves_out_pixels_without_a_derived_normal(cross, plain) -> None:
    derived = MASK.flip(-1)
    target = torch.where(derived, TARGET, 0.0).requires_grad_()
    found = cross(PREDS, target, MASK)
    assert torch.equal(found, plain(PREDS, TARGET, MASK & derived))
    assert found != plain(PREDS, target, MASK)
    found.backward()
    assert target.grad is not None
    assert (target.grad != 0).any()  # depth learns from its normals
    assert (target.grad[~(MASK & derived).expand_as(target)] == 0).all()
