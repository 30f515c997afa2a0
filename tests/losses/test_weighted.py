"""The weighted sum, and the geometry of its cross-task term."""

from typing import Any

import pytest
import torch
from torch import Tensor

from col3d.batch import Batch, Prediction
from col3d.geometry import Camera, OmnidirectionalCamera, PinholeCamera, normals_from_depth
from col3d.losses import WeightedLoss, cross_task_l1, cross_task_rmse, normal_l1, normal_rmse, silog

SIZE_HW = (54, 68)


def batch_of(look: Any, camera: Camera) -> Batch:
    depth, normals, mask = look("tube", camera.rays())
    twice = {"depth": depth.float(), "normals": normals.float(), "mask": mask, "rays": camera.rays()[None]}
    maps = {key: value.expand(2, -1, -1, -1).contiguous() for key, value in twice.items()}
    image = torch.rand(2, 3, *SIZE_HW)
    return {"image": image, "video": ["a", "b"], "frame": torch.tensor([0, 1]), **maps}  # type: ignore[typeddict-item]


def guess_of(batch: Batch) -> Prediction:
    noise = torch.randn(2, 3, *SIZE_HW, generator=torch.Generator().manual_seed(0))
    normals = torch.nn.functional.normalize(batch["normals"] + 0.2 * noise, dim=1)
    bumps = 1 + 0.05 * torch.sin(torch.arange(68.0) / 5)
    return {"depth": batch["depth"].clamp(1, 99) * bumps, "normals": normals}


@pytest.fixture
def lens(look: Any) -> Batch:
    return batch_of(look, OmnidirectionalCamera.c3vd().resized(SIZE_HW))


@pytest.mark.parametrize(
    ("names", "functions"),
    [
        (("silog", "l1", "rmse"), (silog, normal_l1, cross_task_rmse)),
        (("silog", "l2", "l1"), (silog, normal_rmse, cross_task_l1)),
    ],
)
def test_terms_and_their_sum(lens: Batch, names: Any, functions: Any) -> None:
    guess = guess_of(lens)
    found = WeightedLoss([0.5, 0.3, 0.2], *names)(guess, lens)
    mask, derived = lens["mask"], normals_from_depth(guess["depth"], lens["rays"], lens["mask"])
    depth = functions[0](guess["depth"], lens["depth"], mask)
    normals = functions[1](guess["normals"], lens["normals"], mask)
    consistency = functions[2](guess["normals"], derived, mask)
    assert list(found) == ["depth", "normals", "consistency", "total"]
    assert torch.equal(found["depth"], depth)
    assert torch.equal(found["normals"], normals)
    assert torch.equal(found["consistency"], consistency)
    torch.testing.assert_close(found["total"], 0.5 * depth + 0.3 * normals + 0.2 * consistency)


def test_depth_alone_needs_no_normals(lens: Batch) -> None:
    del lens["normals"]
    found = WeightedLoss([2.0])({"depth": lens["depth"] * 1.3}, lens)
    assert set(found) == {"depth", "total"}
    assert found["total"] == 2 * found["depth"]


@pytest.mark.parametrize(
    ("lambdas", "names", "message"),
    [
        ([0.5, 0.5], {}, r"loss\.lambdas: expected 1 weights \(depth\), got 2"),
        (
            [0.5, 0.5],
            {"normals": "l1", "consistency": "l1"},
            r"expected 3 .*depth, normals, consistency.* got 2",
        ),
        ([], {}, r"loss\.lambdas: expected 1"),
        ([1.0], {"depth": "silogg"}, r"loss\.depth: 'silogg' is unknown; did you mean 'silog'"),
        ([1.0, 1.0], {"normals": "l3"}, r"loss\.normals: 'l3' is unknown"),
        ([1.0, 1.0], {"consistency": "mse"}, r"loss\.consistency: 'mse' is unknown"),
        ([1.0], {"geometry": "ray"}, r"loss\.geometry: 'ray' is unknown; did you mean 'rays'"),
    ],
)
def test_wrong_options(lambdas: list[float], names: dict[str, str], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        WeightedLoss(lambdas, **names)


def consistency(batch: Batch, guess: Prediction, geometry: str) -> Tensor:
    loss = WeightedLoss([0.5, 0.3, 0.2], normals="l1", consistency="rmse", geometry=geometry)
    found: Tensor = loss(guess, batch)["consistency"]
    return found


def test_geometries_agree_under_the_pinhole(look: Any) -> None:
    batch = batch_of(look, PinholeCamera.c3vd().resized(SIZE_HW))
    guess = guess_of(batch)
    rays, pinhole = (consistency(batch, guess, geometry) for geometry in ("rays", "pinhole"))
    torch.testing.assert_close(rays, pinhole, atol=1e-6, rtol=0)


def test_geometries_differ_under_the_true_lens(lens: Batch) -> None:
    truth: Prediction = {"depth": lens["depth"], "normals": lens["normals"]}
    assert consistency(lens, truth, "rays") < 0.01  # what is left is the coarse grid
    assert consistency(lens, truth, "pinhole") > 0.1


@pytest.mark.parametrize("name", ["rmse", "l1"])
def test_consistent_tasks_cost_nothing(lens: Batch, name: str) -> None:
    depth = guess_of(lens)["depth"].requires_grad_()
    normals = normals_from_depth(depth.detach(), lens["rays"], lens["mask"]).requires_grad_()
    found = WeightedLoss([0.0, 0.0, 1.0], normals="l1", consistency=name)(
        {"depth": depth, "normals": normals}, lens
    )
    found["total"].backward()
    assert found["consistency"] == 0
    assert depth.grad is not None
    assert depth.grad.isfinite().all()


def test_every_prediction_learns_and_masked_pixels_do_not(lens: Batch) -> None:
    guess = guess_of(lens)
    lens["mask"] &= torch.rand(lens["mask"].shape, generator=torch.Generator().manual_seed(1)) > 0.2
    outside = ~lens["mask"]
    depth = torch.where(outside, torch.nan, guess["depth"]).requires_grad_()
    normals = torch.where(outside, torch.nan, guess["normals"]).requires_grad_()
    for key in ("depth", "normals"):
        lens[key] = torch.where(outside, torch.nan, lens[key])  # type: ignore[literal-required]
    found = WeightedLoss([0.5, 0.3, 0.2], normals="l1", consistency="rmse")(
        {"depth": depth, "normals": normals}, lens
    )
    found["total"].backward()
    assert found["total"].isfinite()
    for values in (depth, normals):
        assert values.grad is not None
        assert (values.grad[outside.expand_as(values)] == 0).all()
        inside = values.grad[~outside.expand_as(values)]
        assert inside.isfinite().all()
        assert (inside != 0).float().mean() > 0.9


def test_half_precision_under_autocast(lens: Batch) -> None:
    guess = guess_of(lens)
    half: Prediction = {"depth": guess["depth"].bfloat16(), "normals": guess["normals"].bfloat16()}
    wide: Prediction = {"depth": half["depth"].float(), "normals": half["normals"].float()}
    loss = WeightedLoss([0.5, 0.3, 0.2], normals="l1", consistency="rmse")
    with torch.autocast("cpu", dtype=torch.bfloat16):
        found = loss(half, lens)
    assert found["total"].dtype == torch.float32
    assert torch.equal(found["total"], loss(wide, lens)["total"])
