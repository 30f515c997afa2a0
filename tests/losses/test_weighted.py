"""The weighted sum, and the geometry of its cross-task term."""

from typing import Any

import numpy as np
import pytest
import torch
from refusals import refused
from torch import Tensor

from col3d.batch import Batch, Prediction
from col3d.errors import UserError
from col3d.geometry import Camera, OmnidirectionalCamera, PinholeCamera, normals_from_depth
from col3d.losses import WeightedLoss, cross_task_l1, cross_task_rmse, normal_l1, normal_rmse, silog
from col3d.losses.depth_regression import depth_l1, rmse_log
from col3d.losses.gradients import gradient_direction, gradient_l1

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
    ("normals", "consistency", "functions"),
    [
        ("normal_l1", "cross_task_rmse", (silog, normal_l1, cross_task_rmse)),
        ("normal_rmse", "cross_task_l1", (silog, normal_rmse, cross_task_l1)),
    ],
)
def test_terms_and_their_sum(lens: Batch, normals: Any, consistency: Any, functions: Any) -> None:
    guess = guess_of(lens)
    found = WeightedLoss([0.5, 0.3, 0.2], {"depth": "silog", "normals": normals, "consistency": consistency})(
        guess, lens
    )
    mask, derived = lens["mask"], normals_from_depth(guess["depth"], lens["rays"], lens["mask"])
    depth = functions[0](guess["depth"], lens["depth"], mask)
    normals = functions[1](guess["normals"], lens["normals"], mask)
    consistency = functions[2](guess["normals"], derived, mask)
    assert list(found) == ["depth", "normals", "consistency", "total"]
    assert torch.equal(found["depth"], depth)
    assert torch.equal(found["normals"], normals)
    assert torch.equal(found["consistency"], consistency)
    torch.testing.assert_close(found["total"], 0.5 * depth + 0.3 * normals + 0.2 * consistency)


@pytest.mark.parametrize(
    ("term", "function", "factor"),
    [
        ("silog", silog, 1),
        ("rmse_log", rmse_log, 1),
        ("depth_l1", depth_l1, 2 / 80),
        ("gradient_l1", gradient_l1, 1 / 80),
        ("gradient_direction", gradient_direction, 1),
    ],
)
def test_terms_of_depth_are_their_functions_at_their_scale(
    lens: Batch, term: str, function: Any, factor: float
) -> None:
    depth = guess_of(lens)["depth"]
    found = WeightedLoss([1.0], {"x": term}, max_depth=80.0)({"depth": depth}, lens)["x"]
    torch.testing.assert_close(found, factor * function(depth, lens["depth"], lens["mask"]))
    assert found > 0


def test_the_loss_of_pix2pix_is_100_times_the_error_of_depth_in_minus_1_to_1(lens: Batch) -> None:
    depth = guess_of(lens)["depth"]
    found = WeightedLoss([100.0], {"depth": "depth_l1"}, max_depth=80.0)({"depth": depth}, lens)["total"]
    ours, theirs = (2 * values.double().numpy() / 80 - 1 for values in (depth, lens["depth"]))
    expected = 100 * np.abs(ours - theirs)[lens["mask"].numpy()].mean()
    assert found.item() == pytest.approx(expected, rel=1e-5)


MONODEPTH_FPN: dict[str, Any] = {
    "depth": "rmse_log",
    "gradients": {"term": "gradient_l1", "from_epoch": 4},
    "directions": {"term": "gradient_direction", "from_epoch": 8},
}
NORMALS = {"depth": "silog", "normals": "normal_l1"}
CONSISTENT: dict[str, Any] = {**NORMALS, "consistency": "cross_task_rmse"}


@pytest.mark.parametrize(("epoch", "count"), [(0, 1), (3, 1), (4, 2), (7, 2), (8, 3), (99, 3), (None, 3)])
def test_a_term_counts_from_its_epoch_and_is_told_before(lens: Batch, epoch: int | None, count: int) -> None:
    lambdas = [1.0, 10.0, 2.0]
    loss = WeightedLoss(lambdas, MONODEPTH_FPN)
    found = loss(guess_of(lens), lens, epoch)
    assert list(found) == [*MONODEPTH_FPN, "total"]
    assert all(found[name] > 0 for name in MONODEPTH_FPN)
    expected = sum(
        weight * found[name] for weight, name in [*zip(lambdas, MONODEPTH_FPN, strict=True)][:count]
    )
    torch.testing.assert_close(found["total"], expected)


def test_before_a_term_counts_its_prediction_has_a_gradient_of_zero(lens: Batch) -> None:
    """DDP waits for the gradient of every parameter."""
    maps: dict[str, Any] = {**guess_of(lens)}
    guess = {key: value.requires_grad_() for key, value in maps.items()}
    later = {name: {"term": term, "from_epoch": 2 - i} for i, (name, term) in enumerate(NORMALS.items())}
    found = WeightedLoss([0.5, 0.5], later)(guess, lens, 0)
    assert found["total"] == 0
    found["total"].backward()
    assert all(torch.equal(value.grad, torch.zeros_like(value)) for value in guess.values())


def test_a_frame_without_truth_adds_nothing(lens: Batch) -> None:
    terms = {**CONSISTENT, **MONODEPTH_FPN, "depth": "depth_l1"}
    loss, maps = WeightedLoss([1.0] * 5, terms), {**guess_of(lens)}
    one: Any = {key: value[:1] for key, value in lens.items()}
    expected = loss({key: value[:1] for key, value in maps.items()}, one)  # type: ignore[attr-defined]
    lens["mask"] = lens["mask"] & torch.tensor([True, False])[:, None, None, None]
    lens["depth"][1] = float("nan")
    guess: Any = {key: value.requires_grad_() for key, value in maps.items()}  # type: ignore[attr-defined]
    found = loss(guess, lens)
    torch.testing.assert_close(found, expected)
    found["total"].backward()
    for value in guess.values():
        assert (value.grad[1] == 0).all()
        assert (value.grad[0] != 0).any()


def test_depth_alone_needs_no_normals(lens: Batch) -> None:
    del lens["normals"]
    found = WeightedLoss([2.0], {"depth": "silog"})({"depth": lens["depth"] * 1.3}, lens)
    assert set(found) == {"depth", "total"}
    assert found["total"] == 2 * found["depth"]


@pytest.mark.parametrize(
    ("lambdas", "terms", "about", "named"),
    [
        ([0.5, 0.5], {"depth": "silog"}, "loss.lambdas", (1, "(depth)", 2)),
        ([0.5, 0.5], CONSISTENT, "loss.lambdas", (3, "depth, normals, consistency", 2)),
        ([], {"depth": "silog"}, "loss.lambdas", (1, 0)),
        ([1.0], {"depth": "silogg"}, "loss.terms", ("'silogg'", "'silog'")),
        ([1.0], {"depth": {"term": "silog", "from_epoch": -1}}, None, ("from_epoch", "or equal to 0")),
        ([1.0], {"depth": {"term": "silog", "variance": 0.5}}, None, ("variance",)),
        ([1.0], {"depth": {"name": "silog"}}, "loss.terms", ("{term: NAME",)),
        (
            [1.0],
            {"x": {"term": "cross_task_l1", "geometry": "ray"}},
            None,
            ("geometry", "'rays' or 'pinhole'"),
        ),
    ],
)
def test_wrong_options(
    lambdas: list[float], terms: dict[str, Any], about: str | None, named: tuple[object, ...]
) -> None:
    with refused(ValueError, about, *named):
        WeightedLoss(lambdas, terms)


def consistency(batch: Batch, guess: Prediction, geometry: str) -> Tensor:
    loss = WeightedLoss(
        [0.5, 0.3, 0.2], {**NORMALS, "consistency": {"term": "cross_task_rmse", "geometry": geometry}}
    )
    found: Tensor = loss(guess, batch)["consistency"]
    return found


def test_geometries_agree_under_the_pinhole(look: Any) -> None:
    batch = batch_of(look, PinholeCamera.c3vd_published(SIZE_HW))
    guess = guess_of(batch)
    rays, pinhole = (consistency(batch, guess, geometry) for geometry in ("rays", "pinhole"))
    torch.testing.assert_close(rays, pinhole, atol=0, rtol=0.02)  # central and forward differences


def test_the_pinhole_looks_at_no_rays_and_differs_forwards(lens: Batch) -> None:
    guess, rays = guess_of(lens), PinholeCamera.c3vd_published(SIZE_HW).rays()
    derived = normals_from_depth(guess["depth"], rays, lens["mask"], differences="forward")
    expected = cross_task_rmse(guess["normals"], derived, lens["mask"])
    assert torch.equal(consistency(lens, guess, "pinhole"), expected)


def test_geometries_differ_under_the_true_lens(lens: Batch) -> None:
    truth: Prediction = {"depth": lens["depth"], "normals": lens["normals"]}
    assert consistency(lens, truth, "rays") < 0.01  # what is left is the coarse grid
    assert consistency(lens, truth, "pinhole") > 0.1


@pytest.mark.parametrize("name", ["cross_task_rmse", "cross_task_l1"])
def test_consistent_tasks_cost_nothing(lens: Batch, name: str) -> None:
    depth = guess_of(lens)["depth"].requires_grad_()
    normals = normals_from_depth(depth.detach(), lens["rays"], lens["mask"]).requires_grad_()
    found = WeightedLoss([0.0, 0.0, 1.0], {**NORMALS, "consistency": name})(
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
    found = WeightedLoss([0.5, 0.3, 0.2], CONSISTENT)({"depth": depth, "normals": normals}, lens)
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
    loss = WeightedLoss([0.5, 0.3, 0.2], CONSISTENT)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        found = loss(half, lens)
    assert found["total"].dtype == torch.float32
    assert torch.equal(found["total"], loss(wide, lens)["total"])


def test_a_term_may_be_any_function_and_the_sum_says_what_it_is(lens: Batch) -> None:
    def far(prediction: Prediction, batch: Batch) -> Tensor:
        return prediction["depth"].max()

    pinhole = {"term": "cross_task_rmse", "geometry": "pinhole"}
    loss = WeightedLoss([0.5, 0.25, 2.0], {"depth": "silog", "own": far, "agreement": pinhole})
    assert loss.formula == "0.5 silog + 0.25 own + 2 cross_task_rmse(geometry=pinhole)"
    guess = guess_of(lens)
    assert torch.equal(loss(guess, lens)["own"], guess["depth"].max())


@pytest.mark.parametrize(
    ("value", "came"), [(3.0, "float"), (None, "NoneType"), (torch.ones(2), "shape (2,)")]
)
def test_what_is_no_scalar_is_said_with_the_option(lens: Batch, value: Any, came: str) -> None:
    prediction: Prediction = {"depth": lens["depth"]}
    loss = WeightedLoss([1.0], {"mine": lambda prediction, batch: value})
    with refused(UserError, "loss.terms.mine", "one number", f"got {came}"):
        loss(prediction, lens)
    balanced = WeightedLoss([1.0], {"depth": "silog"}, balance=lambda losses, lambdas: value)
    with refused(UserError, "loss.balance", "one number", f"got {came}"):
        balanced(prediction, lens)
