"""What a network may return."""

from typing import Any

import pytest
import torch
from refusals import refused

from col3d.batch import check_prediction
from col3d.errors import UserError

IMAGE, DEPTH, NORMALS = torch.zeros(2, 3, 4, 6), torch.ones(2, 1, 4, 6), torch.ones(2, 3, 4, 6)


@pytest.mark.parametrize("more", [{}, {"normals": NORMALS}, {"maps": 3}])
def test_depth_of_each_image_is_a_prediction(more: dict[str, Any]) -> None:
    check_prediction({"depth": DEPTH, **more}, IMAGE, "Net")


@pytest.mark.parametrize(
    ("prediction", "came"),
    [
        (None, "NoneType"),
        (DEPTH, "Tensor"),
        ((DEPTH, NORMALS), "tuple"),
        ({}, "a dict of []"),
        ({"deep": DEPTH}, "a dict of ['deep']"),
        ({"depth": DEPTH[:, 0]}, "depth (2, 4, 6)"),
        ({"depth": DEPTH[:1]}, "depth (1, 1, 4, 6)"),
        ({"depth": NORMALS}, "depth (2, 3, 4, 6)"),
        ({"depth": [DEPTH]}, "depth list"),
        ({"depth": DEPTH, "normals": DEPTH}, "normals (2, 1, 4, 6)"),
    ],
)
def test_what_is_none_is_said_with_what_came(prediction: Any, came: str) -> None:
    with refused(UserError, "model", "Net ", "depth (2, 1, 4, 6)", "(2, 3, 4, 6)", f"got {came}"):
        check_prediction(prediction, IMAGE, "Net")
