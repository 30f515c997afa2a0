"""Normals of depth maps: surfaces known in closed form, and laws."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor
from torch.nn.functional import max_pool2d

from col3d.geometry import (
    Camera,
    OmnidirectionalCamera,
    PinholeCamera,
    angle_between,
    normals_from_depth,
    unit,
)

LENS = OmnidirectionalCamera.c3vd()
SMALL = LENS.resized((48, 60))
ROUGH = 1.0 + torch.rand(2, 1, 48, 60, generator=torch.Generator().manual_seed(1))
MIRROR = torch.tensor([-1.0, 1.0, 1.0])[:, None, None]


def errors(found: Tensor, normals: Tensor, mask: Tensor) -> Tensor:
    """Degrees, where normals were derived (with both neighbours in rows and columns)."""
    return angle_between(found.double(), normals)[mask & (found != 0).any(dim=1, keepdim=True)]


@pytest.mark.parametrize("kind", ["omnidirectional", "pinhole"])
@pytest.mark.parametrize(
    ("scene", "median", "largest"),
    [("frontal", 1e-3, 5e-3), ("plane", 1e-3, 5e-3), ("sphere", 5e-3, 0.5), ("tube", 5e-3, 2.0)],
)
def test_analytic_surfaces(look, scene: str, median: float, largest: float, kind: str) -> None:
    camera: Camera = (LENS if kind == "omnidirectional" else PinholeCamera.c3vd()).resized((360, 450))
    depth, normals, mask = look(scene, camera.rays())
    found = normals_from_depth(depth.float(), camera.rays(), mask)
    assert (found != 0).any(dim=1, keepdim=True)[mask].float().mean() > 0.999
    wrong = errors(found, normals, mask)
    assert mask.float().mean() > 0.4
    assert wrong.median() < median
    assert wrong.max() < largest  # one-sided, at the rim
    between = max_pool2d((~mask).float(), 3, 1, padding=1) == 0
    between[..., [0, -1]] = between[..., [0, -1], :] = False
    assert errors(found, normals, between).max() < 0.08


@pytest.mark.parametrize("scene", ["plane", "sphere", "tube"])
def test_another_lens_gives_other_normals(look, scene: str) -> None:
    """What the tolerances above would catch: the pinhole on frames of the true lens."""
    camera = LENS.resized((360, 450))
    depth, normals, mask = look(scene, camera.rays())
    rays = PinholeCamera.c3vd().resized((360, 450)).rays()
    assert errors(normals_from_depth(depth.float(), rays, mask), normals, mask).median() > 10


def test_known_normals_are_unit_and_face_the_camera(look) -> None:
    depth, _, mask = look("tube", SMALL.rays())
    for values, rays in ((depth.float(), SMALL.rays()), (ROUGH, SMALL.rays())):
        found = normals_from_depth(values, rays, mask.expand_as(values))
        known = (found != 0).any(dim=1)
        assert known.sum() > 1000
        torch.testing.assert_close(found.norm(dim=1)[known], torch.ones(int(known.sum())))
        assert ((found * rays).sum(dim=1)[known] < 0).all()


@given(seed=st.integers(0, 2**31), spread=st.floats(0.0, 1.9))
@settings(max_examples=25, deadline=None)
def test_faces_the_camera_whatever_the_depth(seed: int, spread: float) -> None:
    """Up to 45 times as deep as the neighbour, in a patch of the full frame."""
    noise = torch.randn(1, 1, 12, 14, generator=torch.Generator().manual_seed(seed))
    rays = LENS.cropped(300, 900, 12, 14).rays()
    found = normals_from_depth((noise.tanh() * spread).exp() * 20, rays)
    assert ((found * rays).sum(dim=1) < 0).all()


def test_scale_of_depth_is_of_no_matter() -> None:
    expected = normals_from_depth(ROUGH, SMALL.rays())
    for scale in (1e-2, 1e2, 1e5):
        found = normals_from_depth(ROUGH * scale, SMALL.rays())
        torch.testing.assert_close(found, expected, atol=1e-4, rtol=0)


def test_mirrored_frames_have_mirrored_normals() -> None:
    mask = torch.rand(2, 1, 48, 60, generator=torch.Generator().manual_seed(2)) > 0.2
    expected = normals_from_depth(ROUGH, SMALL.rays(), mask).flip(-1) * MIRROR
    found = normals_from_depth(ROUGH.flip(-1), SMALL.flipped().rays(), mask.flip(-1))
    torch.testing.assert_close(found, expected, atol=2e-4, rtol=0)


def test_turned_frames_have_turned_normals() -> None:
    camera = LENS.resized((50, 50))
    depth = ROUGH[..., :48, :48]
    camera = camera.cropped(1, 1, 48, 48)
    plain = torch.rot90(normals_from_depth(depth, camera.rays()), -1, (-2, -1))
    expected = torch.stack([-plain[:, 1], plain[:, 0], plain[:, 2]], dim=1)
    found = normals_from_depth(torch.rot90(depth, -1, (-2, -1)), camera.rolled(90.0).rays())
    torch.testing.assert_close(found, expected, atol=2e-4, rtol=0)


def test_cropped_frames_have_cropped_normals() -> None:
    whole = normals_from_depth(ROUGH, SMALL.rays())[..., 6:40, 11:52]
    part = normals_from_depth(ROUGH[..., 6:40, 11:52], SMALL.cropped(6, 11, 34, 41).rays())
    assert torch.equal(part[..., 1:-1, 1:-1], whole[..., 1:-1, 1:-1])


def test_a_third_of_the_pixels_gives_nearly_the_same_normals(look) -> None:
    camera = LENS.resized((360, 450))
    small = camera.resized((120, 150))
    torch.testing.assert_close(small.rays(), camera.rays()[:, 1::3, 1::3], atol=1e-6, rtol=0)
    depth, normals, mask = look("sphere", camera.rays())
    found = normals_from_depth(depth[..., 1::3, 1::3].float(), small.rays(), mask[..., 1::3, 1::3])
    wrong = errors(found, normals[..., 1::3, 1::3], mask[..., 1::3, 1::3])
    assert wrong.median() < 0.1
    assert wrong.max() < 2


def test_one_sided_beside_what_is_masked(look) -> None:
    """On a plane every stencil is exact, so that a masked neighbour may not be felt at all."""
    depth, normals, mask = look("plane", SMALL.rays())
    mask &= torch.rand(mask.shape, generator=torch.Generator().manual_seed(3)) > 0.3
    found = normals_from_depth(torch.where(mask, depth.float(), torch.nan), SMALL.rays(), mask)
    assert errors(found, normals, mask).max() < 0.02
    assert (found != 0).any(dim=1, keepdim=True)[mask].float().mean() > 0.7


def test_a_step_is_felt_on_neither_side_of_a_masked_column(look) -> None:
    depth, normals, mask = look("plane", SMALL.rays())
    depth[..., 30:] *= 0.5  # another plane, with the same normal
    mask[..., 30] = False
    found = normals_from_depth(depth.float(), SMALL.rays(), mask)
    assert errors(found, normals, mask).max() < 0.02


def test_no_neighbour_no_normal() -> None:
    mask = torch.zeros(1, 1, 9, 9, dtype=torch.bool)
    mask[0, 0, 1, 1] = True  # alone
    mask[0, 0, 4, 2:7] = True  # a row without a column
    mask[0, 0, 7:, 7:] = True  # four that have both
    found = normals_from_depth(ROUGH[:1, :, :9, :9], SMALL.cropped(0, 0, 9, 9).rays(), mask)
    known = (found != 0).any(dim=1)[0]
    assert known.nonzero().tolist() == [[7, 7], [7, 8], [8, 7], [8, 8]]


def test_rays_that_do_not_point_ahead_have_no_normal() -> None:
    rays = SMALL.rays().clone()
    rays[:, :, :5] = torch.tensor([0.6, 0.8, 0.0])[:, None, None]
    rays[:, :, 5:9] = torch.tensor([0.6, 0.0, -0.8])[:, None, None]
    depth = ROUGH.clone().requires_grad_()
    found = normals_from_depth(depth, rays)
    found.sum().backward()
    assert (found[..., :9] == 0).all()
    assert ((found != 0).any(dim=1)[0] == (rays[2] > 1e-3)).all()
    assert depth.grad is not None
    assert depth.grad.isfinite().all()
    assert (depth.grad[..., :9] == 0).all()


@pytest.mark.parametrize("junk", [float("nan"), float("inf"), -float("inf"), 0.0, -7.0])
def test_masked_depth_is_inert(junk: float) -> None:
    mask = torch.rand(2, 1, 48, 60, generator=torch.Generator().manual_seed(4)) > 0.4
    expected = normals_from_depth(ROUGH, SMALL.rays(), mask)
    depth = torch.where(mask, ROUGH, junk).requires_grad_()
    found = normals_from_depth(depth, SMALL.rays(), mask)
    assert torch.equal(found, expected)
    found.sum().backward()
    assert depth.grad is not None
    assert depth.grad.isfinite().all()
    assert (depth.grad[~mask] == 0).all()


def test_gradient_is_that_of_finite_differences() -> None:
    camera = LENS.resized((12, 15)).cropped(3, 2, 5, 6)
    depth = (ROUGH[:, :, :5, :6].double() * 20).requires_grad_()
    mask = torch.ones_like(depth, dtype=torch.bool)
    mask[0, 0, 2, 3] = mask[1, 0, 0, :4] = False
    assert torch.autograd.gradcheck(lambda d: normals_from_depth(d, camera.rays().double(), mask), (depth,))


@pytest.mark.parametrize("scale", [0.0, 1e-12, 1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-3, 1e6, 1e12, 1e15])
def test_gradient_is_finite_at_any_depth(scale: float) -> None:
    for camera in (SMALL, LENS.cropped(500, 100, 48, 60)):
        depth = (ROUGH * scale).requires_grad_()
        found = normals_from_depth(depth, camera.rays())
        found.sum().backward()
        assert found.isfinite().all()
        assert depth.grad is not None
        assert depth.grad.isfinite().all()


def test_batched_is_single() -> None:
    mask = torch.rand(2, 1, 48, 60, generator=torch.Generator().manual_seed(5)) > 0.1
    rays = torch.stack([SMALL.rays(), SMALL.flipped().rays()])
    batched = normals_from_depth(ROUGH, rays, mask)
    for i in range(2):
        single = normals_from_depth(ROUGH[i : i + 1], rays[i], mask[i : i + 1])
        torch.testing.assert_close(batched[i : i + 1], single, atol=1e-6, rtol=0)


def test_one_map_of_rays_is_one_for_each_frame() -> None:
    rays = SMALL.rays()
    expected = normals_from_depth(ROUGH, rays.expand(2, 3, 48, 60))
    assert torch.equal(normals_from_depth(ROUGH, rays), expected)
    everywhere = torch.ones(2, 1, 48, 60, dtype=torch.bool)
    assert torch.equal(normals_from_depth(ROUGH, rays, everywhere), expected)


@pytest.mark.parametrize("dtype", [torch.bfloat16, torch.float16])
def test_half_precision_is_computed_in_float32(dtype: torch.dtype) -> None:
    depth = (ROUGH * 30).to(dtype)
    expected = normals_from_depth(depth.float(), SMALL.rays())
    with torch.autocast("cpu", dtype=torch.bfloat16):
        under_autocast = normals_from_depth(depth, SMALL.rays())
    for found in (normals_from_depth(depth, SMALL.rays()), under_autocast):
        assert found.dtype == torch.float32
        assert torch.equal(found, expected)


def angle_twin(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Kahan's formula, 2 atan2(|a/|a| - b/|b||, |a/|a| + b/|b||), in float64."""
    a, b = (v.astype(np.float64) / np.linalg.norm(v.astype(np.float64), axis=0) for v in (a, b))
    degrees: np.ndarray = np.degrees(
        2 * np.arctan2(np.linalg.norm(a - b, axis=0), np.linalg.norm(a + b, axis=0))
    )
    return degrees


@pytest.mark.parametrize("degrees", [1e-4, 1e-2, 1.0, 89.0, 90.0, 91.0, 179.0, 179.99, 180.0 - 1e-4])
def test_angles_near_a_given_one(degrees: float) -> None:
    generator = torch.Generator().manual_seed(6)
    first, other = torch.randn(2, 3, 20, 20, dtype=torch.float64, generator=generator)
    first = first / first.norm(dim=0)
    other = other - (other * first).sum(dim=0) * first
    other = other / other.norm(dim=0)
    turn = torch.tensor(degrees, dtype=torch.float64).deg2rad()
    a, b = first.float(), (turn.cos() * first + turn.sin() * other).float()
    found = angle_between(a, b)
    np.testing.assert_allclose(found[0].numpy(), angle_twin(a.numpy(), b.numpy()), atol=3e-5)
    if degrees < 1:
        np.testing.assert_allclose(found[0].numpy(), degrees, atol=1e-5)


def test_angles_at_the_ends_are_exact() -> None:
    vectors = torch.randn(4, 3, 50, 50, generator=torch.Generator().manual_seed(7))
    assert (angle_between(vectors, vectors) == 0).all()
    assert (angle_between(vectors, -vectors) == 180).all()
    assert (angle_between(vectors, 4 * vectors) == 0).all()


@pytest.mark.parametrize("lengths", [(1.0, 1e-8), (1e-8, 1e-8), (1e8, 1e-8), (1e8, 1e8), (3.0, 0.01)])
def test_length_is_of_no_matter(lengths: tuple[float, float]) -> None:
    a, b = torch.randn(2, 3, 30, 30, generator=torch.Generator().manual_seed(8))
    found = angle_between(a * lengths[0], b * lengths[1])
    np.testing.assert_allclose(found[0].numpy(), angle_twin(a.numpy(), b.numpy()), atol=1e-4)


def test_zero_vectors_give_no_nan() -> None:
    a = torch.zeros(1, 3, 1, 4)
    a[0, 0, 0, 2:] = 1
    b = torch.zeros(1, 3, 1, 4)
    b[0, 1, 0, 1::2] = 1
    a.requires_grad_()
    b.requires_grad_()
    found = angle_between(a, b)
    found.sum().backward()
    assert found.flatten().tolist() == [0, 0, 0, 90]
    assert a.grad is not None
    assert b.grad is not None
    assert a.grad.isfinite().all()
    assert b.grad.isfinite().all()
    assert a.grad[0, :, 0, 3].tolist() == pytest.approx([0, -180 / np.pi, 0])


def test_unit_of_any_length() -> None:
    directions = torch.nn.functional.normalize(torch.randn(1, 3, 9, 9), dim=1)
    for length in (1e-11, 1e-3, 1.0, 1e18):
        torch.testing.assert_close(unit(directions * length), directions, atol=1e-6, rtol=0)


@pytest.mark.parametrize("length", [0.0, 1e-20, 1e-16, 1e-15, 1e-14, 1e-13, 1e-12, 1e-11, 1.0, 1e12])
def test_gradient_of_unit_is_finite(length: float) -> None:
    generator = torch.Generator().manual_seed(9)
    vectors = (torch.randn(1, 3, 30, 30, generator=generator) * length).requires_grad_()
    unit(vectors).sum().backward()
    assert vectors.grad is not None
    assert vectors.grad.isfinite().all()
    if length == 0:
        assert (unit(vectors) == 0).all()
        assert (vectors.grad == 0).all()
