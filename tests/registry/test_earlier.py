"""Options of earlier versions, and what they are today."""

from typing import Any

import pytest

from col3d.losses import WeightedLoss
from col3d.registry.earlier import updated

GIVEN: dict[str, Any] = {
    "silog": {"depth": "silog", "lambdas": [1.0]},
    "mtl_xtc": {"depth": "silog", "normals": "l1", "consistency": "rmse", "lambdas": [0.5, 0.3, 0.2]},
    "pinhole": {
        **{"depth": "silog", "normals": "l2", "consistency": "l1", "geometry": "pinhole"},
        **{"gradients": None, "directions": None, "from_epoch": None, "lambdas": [0.5, 0.3, 0.2]},
    },
    "monodepth_fpn": {
        **{"depth": "rmse_log", "gradients": "l1", "directions": "cosine", "normals": None},
        **{"lambdas": [1.0, 10.0, 1.0], "from_epoch": [0, 4, 8]},
    },
    "pix2pix": {"depth": "l1", "lambdas": [100.0]},
}
FORMULAS = {
    "silog": "1 silog",
    "mtl_xtc": "0.5 silog + 0.3 normal_l1 + 0.2 cross_task_rmse",
    "pinhole": "0.5 silog + 0.3 normal_rmse + 0.2 cross_task_l1(geometry=pinhole)",
    "monodepth_fpn": "1 rmse_log + 10 gradient_l1 + 1 gradient_direction",
    "pix2pix": "100 depth_l1",
}


@pytest.mark.parametrize("name", GIVEN)
def test_a_loss_of_before_is_the_same_sum(name: str) -> None:
    loss = updated({"seed": 3, "loss": GIVEN[name]})["loss"]
    made = WeightedLoss(loss["lambdas"], loss["terms"])
    assert made.formula == FORMULAS[name]
    assert [*made.from_epoch.values()] == (GIVEN[name].get("from_epoch") or [0] * len(made.terms))


@pytest.mark.parametrize(
    "options", [{}, {"loss": None}, {"loss": {"terms": {"depth": "silog"}}}, {"loss": {}}]
)
def test_what_is_of_today_or_of_nothing_stays_as_it_is(options: dict[str, Any]) -> None:
    assert updated(options) == options
