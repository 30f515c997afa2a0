"""Losses of slopes: twins in numpy that walk over the pixels, kornia's Sobel, planes, and laws."""

import inspect

import laws
import numpy as np
import pytest
import torch
from kornia.filters import spatial_gradient
from refusals import refused
from torch import Tensor

from col3d.losses.gradients import gradient_direction, gradient_l1, sobel, with_neighbours

PREDS, TARGET, MASK = laws.depth_maps(masked=0.05)
ALL = torch.ones_like(MASK)
KERNEL = np.array([[-1.0, 0, 1], [-2, 0, 2], [-1, 0, 1]])


def slopes_twin(depth: Tensor, mask: Tensor) -> list[np.ndarray]:
    """For each frame: (2, n), d/dx and d/dy of each pixel whose 3 x 3 is known."""
    found = []
    for frame, known in zip(depth[:, 0].double().numpy(), mask[:, 0].numpy(), strict=True):
        pairs = [
            [(KERNEL * frame[y : y + 3, x : x + 3]).sum(), (KERNEL.T * frame[y : y + 3, x : x + 3]).sum()]
            for y in range(frame.shape[0] - 2)
            for x in range(frame.shape[1] - 2)
            if known[y : y + 3, x : x + 3].all()
        ]
        found.append(np.array(pairs).T.reshape(2, -1))
    return found


def l1_twin(preds: Tensor, target: Tensor, mask: Tensor) -> float:
    pairs = zip(slopes_twin(preds, mask), slopes_twin(target, mask), strict=True)
    return float(np.abs(np.concatenate([p - t for p, t in pairs], axis=1)).mean())


def direction_twin(preds: Tensor, target: Tensor, mask: Tensor) -> float:
    costs = []
    for ours, theirs in zip(slopes_twin(preds, mask), slopes_twin(target, mask), strict=True):
        costs += [
            1 - p @ t / np.linalg.norm(p) / np.linalg.norm(t) for p, t in zip(ours, theirs, strict=True)
        ]
    return float(np.mean(costs))


LOSSES = [(gradient_l1, l1_twin), (gradient_direction, direction_twin)]
both = pytest.mark.parametrize(("loss", "twin"), LOSSES, ids=["l1", "direction"])


@both
@pytest.mark.parametrize("mask", [MASK, ALL], ids=["holes", "whole"])
def test_slope_loss_equals_its_twin(loss, twin, mask: Tensor) -> None:
    assert 20 < with_neighbours(mask).sum() <= 2 * 11 * 15
    expected = twin(PREDS, TARGET, mask)
    assert loss(PREDS, TARGET, mask).item() == pytest.approx(expected, rel=1e-5)
    assert loss(PREDS.double(), TARGET.double(), mask).item() == pytest.approx(expected, rel=1e-11)


def test_sobel_is_kornias_undivided() -> None:
    theirs = spatial_gradient(PREDS.double(), "sobel", order=1, normalized=False)[:, 0, :, 1:-1, 1:-1]
    torch.testing.assert_close(sobel(PREDS.double()), theirs)


def test_published_formula_inside_the_border() -> None:
    """One long vector per frame and direction; 1 - mean of products over norms."""
    ours, theirs = (sobel(depth.double()).flatten(2) for depth in (PREDS, TARGET))
    cosine = (ours * theirs).sum(-1) / (ours.square().sum(-1).sqrt() * theirs.square().sum(-1).sqrt())
    found = gradient_direction(PREDS.double(), TARGET.double(), ALL)
    torch.testing.assert_close(found, 1 - cosine.mean())
    assert 0.5 < found < 1.5


def plane(across: float, down: float, at_origin: float = 30.0) -> Tensor:
    y, x = torch.meshgrid(torch.arange(7.0), torch.arange(9.0), indexing="ij")
    return (at_origin + across * x + down * y)[None, None]


def test_planes() -> None:
    mask = torch.ones(1, 1, 7, 9, dtype=torch.bool)
    found = gradient_l1(plane(0.5, -1.0), plane(0.25, 1.0), mask)
    assert found.item() == pytest.approx(8 * (0.25 + 2.0) / 2, rel=1e-5)
    assert gradient_direction(plane(0.5, -1.0), plane(0.25, 1.0), mask).item() == pytest.approx((0 + 2) / 2)


@both
def test_only_slopes_count(loss, twin) -> None:
    torch.testing.assert_close(loss(PREDS + 5, TARGET, MASK), loss(PREDS, TARGET, MASK), rtol=1e-4, atol=0)


def test_scale_of_slopes() -> None:
    torch.testing.assert_close(gradient_l1(3 * PREDS, 3 * TARGET, MASK), 3 * gradient_l1(PREDS, TARGET, MASK))
    direction = gradient_direction(PREDS, TARGET, MASK)
    torch.testing.assert_close(gradient_direction(3 * PREDS, 0.1 * TARGET, MASK), direction)
    torch.testing.assert_close(gradient_direction(1e-6 * PREDS, 1e-6 * TARGET, MASK), direction)
    torch.testing.assert_close(gradient_direction(-PREDS, TARGET, MASK), 2 - direction)
    torch.testing.assert_close(gradient_direction(-TARGET, TARGET, MASK), torch.tensor(2.0))


@both
@pytest.mark.parametrize("turn", [lambda x: x.flip(-1), lambda x: x.flip(-2), lambda x: x.transpose(-1, -2)])
def test_mirrored_and_turned_frames_cost_the_same(loss, twin, turn) -> None:
    torch.testing.assert_close(loss(turn(PREDS), turn(TARGET), turn(MASK)), loss(PREDS, TARGET, MASK))


@both
def test_true_slopes_cost_nothing(loss, twin) -> None:
    laws.costs_nothing_at_truth(loss, TARGET, MASK)


@both
@pytest.mark.parametrize("junk", [float("nan"), float("inf"), 0.0, 500.0])
def test_masked_pixels_have_no_slope(loss, twin, junk: float) -> None:
    for gradient in laws.masked_is_inert(loss, PREDS, TARGET, MASK, junk):
        assert (gradient != 0).float().mean() > 0.5


@both
@pytest.mark.parametrize("mask", [torch.zeros_like(MASK), ALL & (torch.arange(17) % 3 > 0)])
def test_no_pixel_has_a_slope(loss, twin, mask: Tensor) -> None:
    laws.costs_nothing(loss, PREDS, TARGET, mask)


@both
@pytest.mark.parametrize("size_hw", [(2, 17), (13, 1), (2, 2), (1, 1)])
def test_frames_too_small_for_slopes(loss, twin, size_hw: tuple[int, int]) -> None:
    preds, target, mask = (maps[..., : size_hw[0], : size_hw[1]] for maps in (PREDS, TARGET, ALL))
    assert loss(preds, target, mask).item() == 0


@both
def test_frames_without_slopes_do_not_count(loss, twin) -> None:
    mask = MASK.clone()
    mask[0] = False
    torch.testing.assert_close(loss(PREDS, TARGET, mask), loss(PREDS[1:], TARGET[1:], MASK[1:]))


@pytest.mark.parametrize("value", [0.1, 33.3, 77.7])
def test_constant_depth_has_no_direction(value: float) -> None:
    flat = torch.full_like(TARGET, value).requires_grad_()
    assert not sobel(flat).any()
    agreed, missed = gradient_direction(flat, flat.detach() / 3, MASK), gradient_direction(flat, TARGET, MASK)
    assert agreed.item() == 0
    assert missed.item() == 1
    assert gradient_direction(TARGET, flat.detach(), MASK).item() == 1
    (agreed + missed).backward()
    assert flat.grad is not None
    assert (flat.grad == 0).all()


def test_one_flat_derivative() -> None:
    """Flat along x in both: only d/dy is compared, and the mean is still over both."""
    mask = torch.ones(1, 1, 7, 9, dtype=torch.bool)
    assert gradient_direction(plane(0, 1), plane(0, -1), mask).item() == pytest.approx((0 + 2) / 2)
    assert gradient_direction(plane(0, 1), plane(0.5, 1), mask).item() == pytest.approx((1 + 0) / 2)


@both
@pytest.mark.parametrize("dtype", [torch.bfloat16, torch.float16])
def test_slopes_of_half_precision(loss, twin, dtype: torch.dtype) -> None:
    half = PREDS.to(dtype)
    laws.half_precision_is_close(loss, half, TARGET, MASK, twin(half, TARGET, MASK), rel=1e-4)


@both
def test_gradient_of_slope_losses(loss, twin) -> None:
    preds, target, mask = (maps[:, :, :4, :5].clone() for maps in (PREDS, TARGET, ALL))
    mask[1, 0, 0, 0] = False
    laws.gradient_is_that_of_finite_differences(loss, preds, target, mask)


@both
@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_slopes_that_are_no_numbers_give_a_loss_that_is_none(loss, twin, bad: float) -> None:
    preds = PREDS.clone()
    preds[0, 0, 5, 5] = bad
    assert not loss(preds, TARGET, ALL).isfinite()


@both
def test_maps_of_other_shapes_have_no_common_slope(loss, twin) -> None:
    unchecked = inspect.unwrap(loss)  # as it is outside of tests, where shapes are no types
    with refused(ValueError, "mask", "(b, 1, h, w)", tuple(MASK[:1].shape)):
        unchecked(PREDS, TARGET, MASK[:1])


def test_known_neighbours() -> None:
    mask = torch.ones(1, 1, 5, 6, dtype=torch.bool)
    mask[0, 0, 0, 0] = False
    expected = torch.ones(1, 1, 3, 4, dtype=torch.bool)
    expected[0, 0, 0, 0] = False
    assert torch.equal(with_neighbours(mask), expected)
