"""Angles, normals and planes: twins in float64, and laws."""

import math

import pytest
import torch

from col3d.layers.planar import (
    PlanarGuidance,
    Reduction,
    cone_normals,
    intersect,
    local_planar_guidance,
    sphere_normals,
)


def guidance_twin(normal: list[list[float]], distance: float, patch: int) -> torch.Tensor:
    """Pixel by pixel: one row of cells, each with a normal, all at one distance."""
    depth = torch.zeros(patch, patch * len(normal), dtype=torch.float64)
    for row in range(patch):
        for column in range(patch * len(normal)):
            n1, n2, n3 = normal[column // patch]
            u = (column % patch - (patch - 1) / 2) / patch
            v = (row - (patch - 1) / 2) / patch
            depth[row, column] = distance / (n1 * u + n2 * v + n3)
    return depth


@pytest.mark.parametrize("patch", [2, 4, 8])
def test_guidance_equals_a_loop_over_pixels(patch: int) -> None:
    normals = [[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.0, -0.6, 0.8]]
    cells = torch.tensor(normals).T[None, :, None]
    depth = local_planar_guidance(cells, torch.full((1, 1, 1, 3), 0.4), patch)
    torch.testing.assert_close(depth[0, 0].double(), guidance_twin(normals, 0.4, patch), atol=1e-6, rtol=0)


def test_frontal_plane_is_flat() -> None:
    frontal = torch.tensor([0.0, 0.0, 1.0]).view(1, 3, 1, 1).expand(2, 3, 3, 5)
    distance = torch.rand(2, 1, 3, 5)
    depth = local_planar_guidance(frontal, distance, 8)
    assert torch.equal(depth, distance.repeat_interleave(8, 2).repeat_interleave(8, 3))


def test_points_of_a_patch_lie_on_its_plane() -> None:
    normal, distance = cone_normals(torch.rand(1, 2, 1, 1) * 0.5), torch.tensor(0.7).view(1, 1, 1, 1)
    depth = local_planar_guidance(normal, distance, 8)[0, 0]
    v, u = torch.meshgrid(*2 * [(torch.arange(8) - 3.5) / 8], indexing="ij")
    points = torch.stack([u * depth, v * depth, depth])
    torch.testing.assert_close(torch.tensordot(normal.flatten(), points, 1), torch.full((8, 8), 0.7))


def test_quotient_stays_finite_inside_the_plane() -> None:
    incidence = torch.tensor([0.0, 1e-9, -1e-9, 0.5], requires_grad=True)
    quotient = intersect(torch.ones(4), incidence)
    (gradient,) = torch.autograd.grad(quotient.sum(), incidence)
    assert quotient.tolist() == pytest.approx([1e4, 1e4, -1e4, 2.0])
    assert gradient.isfinite().all()


def test_cone_is_60_degrees_around_the_optical_axis() -> None:
    normals = cone_normals(torch.rand(1, 2, 50, 50))
    torch.testing.assert_close(normals.norm(dim=1), torch.ones(1, 50, 50))
    assert normals[:, 2].min() >= 0.5 - 1e-6


def test_sphere_reaches_everywhere() -> None:
    normals = sphere_normals(torch.rand(1, 2, 100, 100))
    torch.testing.assert_close(normals.norm(dim=1), torch.ones(1, 100, 100))
    assert (normals.amin(dim=(0, 2, 3)) < -0.99).all()
    assert (normals.amax(dim=(0, 2, 3)) > 0.99).all()


@pytest.mark.parametrize(
    ("unit", "normal"), [((0.0, 0.3), (0, 0, -1)), ((0.5, 0.0), (1, 0, 0)), ((0.5, 0.25), (0, 1, 0))]
)
def test_sphere_in_standard_axes(unit: tuple[float, float], normal: tuple[int, int, int]) -> None:
    found = sphere_normals(torch.tensor(unit).view(1, 2, 1, 1)).flatten()
    torch.testing.assert_close(found, torch.tensor(normal, dtype=torch.float32), atol=1e-6, rtol=0)


def test_reduction_halves_down_to_eight() -> None:
    assert [name for name, _ in Reduction(128, 128, 3).named_children()] == [
        "to128",
        "to64",
        "to32",
        "to16",
        "to8",
        "out",
    ]
    assert [name for name, _ in Reduction(8, 4, 2).named_children()] == ["out"]


def test_untrained_guidance_is_the_middle_of_the_range() -> None:
    guidance = PlanarGuidance(8, 8, patch=4)
    torch.nn.init.zeros_(guidance.reduction.out.weight)
    centre = guidance(torch.rand(1, 8, 2, 3))[0, 0].unfold(0, 4, 4).unfold(1, 4, 4)[..., 1:3, 1:3].mean()
    assert centre.item() == pytest.approx(0.5 / math.cos(math.pi / 6), rel=0.05)


def test_blocks_answer_in_float32_under_autocast() -> None:
    x = torch.rand(1, 16, 2, 2)
    with torch.autocast("cpu", torch.bfloat16):
        assert PlanarGuidance(16, 16, 8)(x).dtype == torch.float32
