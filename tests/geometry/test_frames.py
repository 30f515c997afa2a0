"""The frame of a pixel's own ray: a rotation that turns with the camera."""

import math

import pytest
import torch
from torch import Tensor

from col3d.geometry import OmnidirectionalCamera, camera_from_ray, ray_from_camera, unit


@pytest.fixture(scope="module")
def rays() -> Tensor:
    return OmnidirectionalCamera.c3vd().resized((48, 60)).rays().double()


def axis(values: tuple[float, float, float], like: Tensor) -> Tensor:
    return torch.tensor(values, dtype=like.dtype)[None, :, None, None].expand(1, -1, *like.shape[-2:])


def test_the_optical_axis_goes_onto_the_ray(rays: Tensor) -> None:
    torch.testing.assert_close(camera_from_ray(axis((0.0, 0.0, 1.0), rays), rays)[0], rays, atol=1e-7, rtol=0)


def test_is_the_shortest_rotation(rays: Tensor) -> None:
    """Rodrigues' formula about z x ray, pixel by pixel."""
    vectors = torch.randn(1, 3, *rays.shape[-2:], dtype=torch.float64)
    found = camera_from_ray(vectors, rays)
    for row, column in [(0, 0), (47, 59), (10, 50), (24, 30), (40, 2)]:
        ray, v = unit(rays[:, row, column][:, None, None]).flatten(), vectors[0, :, row, column]
        turn = torch.linalg.cross(torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64), ray)
        sine, cosine = turn.norm(), ray[2]
        k = turn / sine
        expected = v * cosine + torch.linalg.cross(k, v) * sine + k * (k @ v) * (1 - cosine)
        torch.testing.assert_close(found[0, :, row, column], expected, atol=1e-6, rtol=0)


def test_back_and_forth(rays: Tensor) -> None:
    vectors = torch.randn(2, 3, *rays.shape[-2:], dtype=torch.float64)
    torch.testing.assert_close(
        ray_from_camera(camera_from_ray(vectors, rays), rays), vectors, atol=1e-6, rtol=0
    )
    torch.testing.assert_close(camera_from_ray(vectors, rays).norm(dim=1), vectors.norm(dim=1))


def test_rolling_the_camera_rolls_the_result(rays: Tensor) -> None:
    vectors, angle = torch.randn(1, 3, *rays.shape[-2:], dtype=torch.float64), 0.7
    roll = torch.eye(3, dtype=torch.float64)
    roll[:2, :2] = torch.tensor(
        [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]], dtype=torch.float64
    )

    def rolled(values: Tensor) -> Tensor:
        return torch.einsum("ij,...jhw->...ihw", roll, values)

    torch.testing.assert_close(
        camera_from_ray(rolled(vectors), rolled(rays)), rolled(camera_from_ray(vectors, rays))
    )


def test_mirroring_commutes(rays: Tensor) -> None:
    vectors = torch.randn(1, 3, *rays.shape[-2:], dtype=torch.float64)
    mirror = torch.tensor([-1.0, 1.0, 1.0], dtype=torch.float64)[:, None, None]
    torch.testing.assert_close(
        camera_from_ray(vectors * mirror, rays * mirror), mirror * camera_from_ray(vectors, rays)
    )
