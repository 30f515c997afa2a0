"""The decoder of normals, on any features, in the camera's frame and in that of each ray."""

import pytest
import torch
from torch import Tensor

from col3d.geometry import OmnidirectionalCamera, angle_between
from col3d.layers.normal_decoder import (
    NORMAL_FRAMES,
    Features,
    NormalDecoder,
    UnitNormal,
    facing_normals,
    ray_normals,
    shrink_rays,
)

SIZE = (64, 96)


@pytest.fixture(scope="module")
def rays() -> Tensor:
    return OmnidirectionalCamera.c3vd().resized(SIZE).rays()[None]


def features(channels: tuple[int, int, int]) -> Features:
    h, w = SIZE
    return Features(*(torch.randn(1, c, h // k, w // k) for c, k in zip(channels, (2, 4, 8), strict=True)))


@pytest.mark.parametrize("channels", [(8, 16, 32), (0, 24, 40)])
@pytest.mark.parametrize("frame", list(NORMAL_FRAMES))
def test_unit_normals_from_any_features(frame: str, channels: tuple[int, int, int], rays: Tensor) -> None:
    decoder = NormalDecoder(channels, 64, NORMAL_FRAMES[frame])
    normals = decoder(features(channels), rays)
    assert normals.shape == (1, 3, *SIZE)
    torch.testing.assert_close(normals.norm(dim=1), torch.ones(1, *SIZE))
    (normals * torch.randn_like(normals)).sum().backward()
    assert all(p.grad is not None and p.grad.isfinite().all() and p.grad.any() for p in decoder.parameters())


@pytest.mark.parametrize("size", [1.0, 100.0, 1e6])
def test_every_normal_in_the_frame_of_the_ray_faces_the_camera(rays: Tensor, size: float) -> None:
    raw = size * torch.randn(4, 3, *SIZE)
    assert ((facing_normals(raw, rays) * rays).sum(dim=1) < 0).all()
    assert ((ray_normals((0.999 * torch.rand(4, 2, *SIZE)), rays) * rays).sum(dim=1) < 0).all()


def test_the_camera_frame_predicts_surfaces_that_nobody_can_see(rays: Tensor) -> None:
    normals = NORMAL_FRAMES["camera"].of_pixel(torch.randn(1, 3, *SIZE), None)
    assert ((normals * rays).sum(dim=1) > 0).any()


def test_visible_surfaces_that_look_ahead_are_reached(rays: Tensor) -> None:
    """At the rim a wall may face the camera and yet have n_z > 0, which no cone about the axis holds."""
    wanted = torch.tensor([-0.8, 0.0, 0.6])[None, :, None, None]
    ray = torch.tensor([0.96, 0.0, 0.28])[None, :, None, None]
    assert (wanted * ray).sum() < 0
    raw = torch.zeros(1, 3, 1, 1, requires_grad=True)
    optimiser = torch.optim.LBFGS([raw], max_iter=100, line_search_fn="strong_wolfe")

    def distance() -> Tensor:
        optimiser.zero_grad()
        loss: Tensor = (facing_normals(raw, ray) - wanted).square().sum()
        loss.backward()
        return loss

    optimiser.step(distance)
    assert angle_between(facing_normals(raw.detach(), ray), wanted).item() < 0.1


def test_polar_angle_is_measured_from_minus_the_ray(rays: Tensor) -> None:
    fractions = torch.rand(1, 2, *SIZE)
    found = angle_between(ray_normals(fractions, rays), -rays)
    torch.testing.assert_close(found, 90 * fractions[:, :1], atol=2e-2, rtol=0)


def test_both_frames_agree_along_the_optical_axis() -> None:
    ahead = torch.tensor([0.0, 0.0, 1.0])[None, :, None, None].expand(1, 3, 4, 4)
    fractions = torch.rand(1, 2, 4, 4)
    halved = fractions * torch.tensor([0.5, 1.0])[None, :, None, None]
    sphere = NORMAL_FRAMES["camera"].of_cell(halved, None)
    torch.testing.assert_close(ray_normals(fractions, ahead), sphere, atol=1e-6, rtol=0)


def test_rays_of_cells_are_those_of_the_smaller_camera(rays: Tensor) -> None:
    for factor in (2, 4, 8):
        smaller = OmnidirectionalCamera.c3vd().resized((SIZE[0] // factor, SIZE[1] // factor)).rays()[None]
        step = angle_between(smaller[..., 1:], smaller[..., :-1]).mean()
        assert angle_between(shrink_rays(rays, factor), smaller).max() < 0.04 * step


@pytest.mark.parametrize("frame", list(NORMAL_FRAMES))
def test_starts_towards_the_camera(frame: str, rays: Tensor) -> None:
    normals = NormalDecoder((8, 16, 32), 128, NORMAL_FRAMES[frame])(features((8, 16, 32)), rays)
    towards = -rays if frame == "ray" else torch.tensor([0.0, 0.0, -1.0])[None, :, None, None].expand_as(rays)
    assert angle_between(normals, towards).mean() < 30


def test_normals_are_float32_in_mixed_precision(rays: Tensor) -> None:
    x = torch.rand(1, 16, *SIZE)
    with torch.autocast("cpu", torch.bfloat16):
        for frame in NORMAL_FRAMES.values():
            assert UnitNormal(16, 16, frame)(x, rays).dtype == torch.float32
