"""What must not turn into a good-looking number."""

import pytest
import torch
from refusals import refused

from col3d.batch import check_maps
from col3d.losses import cross_task_rmse, normal_l1, normal_rmse, silog
from col3d.metrics import NormalMetrics
from col3d.metrics.functional import depth_metrics, normal_metrics

MASK = torch.ones(2, 1, 4, 5, dtype=torch.bool)
UP = torch.tensor([0.0, 0.0, -1.0]).view(1, 3, 1, 1).expand(2, 3, 4, 5)


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_a_prediction_that_is_no_number_gives_a_loss_that_is_none(bad: float) -> None:
    depth = torch.full((2, 1, 4, 5), 30.0)
    assert not silog(depth * bad, depth, MASK).isfinite()
    for loss in (normal_l1, normal_rmse, cross_task_rmse):
        assert not loss(torch.full_like(UP, bad), UP, MASK).isfinite()


def test_normals_without_direction_score_nothing() -> None:
    values = normal_metrics(torch.zeros_like(UP), UP, MASK)
    assert values["angle_mean"].isnan().all()
    assert values["angle_median"].isnan().all()
    assert values["within_30"].eq(0).all()
    nowhere = normal_metrics(torch.full_like(UP, torch.nan), UP, MASK)
    assert nowhere["angle_mean"].isnan().all()


def test_a_batch_of_nothing_adds_nothing() -> None:
    metric = NormalMetrics()
    metric.update(UP[:0], UP[:0], MASK[:0])
    metric.update(UP, UP, MASK)
    assert metric.frames == 2
    assert metric.compute()["angle_mean"] == 0


def test_shapes_that_would_broadcast_are_refused() -> None:
    depth = torch.full((2, 1, 4, 5), 30.0)
    with refused(ValueError, "mask", "(b, 1, h, w)", "(2, 1, 4, 5)", "(2, 4, 5)"):
        check_maps(depth, depth, MASK[:, 0])
    with refused(ValueError, "preds, target", "(2, 1, 4, 5)", "(2, 3, 4, 5)"):
        check_maps(depth, depth.expand(2, 3, 4, 5), MASK)
    assert depth_metrics(depth, depth, MASK)["abs_rel"].eq(0).all()
