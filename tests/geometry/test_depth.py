"""Points of a depth map."""

import numpy as np
import torch

from col3d.geometry import OmnidirectionalCamera, PinholeCamera, points_from_depth


def test_pinhole_points() -> None:
    camera = PinholeCamera.from_focal((6, 7), 5.0, 4.0, 2.0, 3.0)
    depth = torch.rand(2, 1, 6, 7, dtype=torch.float64) * 90 + 1
    v, u = np.mgrid[:6, :7].astype(np.float64)
    z = depth.numpy()[:, 0]
    expected = np.stack([(u - 2) / 5 * z, (v - 3) / 4 * z, z], axis=1)
    found = points_from_depth(depth, camera.rays().double())
    np.testing.assert_allclose(found.numpy(), expected, atol=2e-5)


def test_points_project_to_their_pixels_and_keep_their_depth() -> None:
    camera = OmnidirectionalCamera.c3vd().resized((108, 135)).cropped(10, 12, 80, 100)
    depth = torch.rand(2, 1, 80, 100) * 90 + 1
    points = points_from_depth(depth, camera.rays())
    torch.testing.assert_close(points[:, 2:], depth)
    v, u = torch.meshgrid(torch.arange(80.0), torch.arange(100.0), indexing="ij")
    pixels = camera.project(points.permute(0, 2, 3, 1))
    assert (pixels - torch.stack([u, v], dim=-1)).abs().max() < 1e-3


def test_one_map_of_rays_or_one_for_each_frame() -> None:
    rays = OmnidirectionalCamera.c3vd().resized((20, 25)).rays()
    depth = torch.rand(3, 1, 20, 25)
    assert torch.equal(points_from_depth(depth, rays), points_from_depth(depth, rays.expand(3, 3, 20, 25)))
