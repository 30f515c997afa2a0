"""Surfaces of known shape come out where they are, and distances between them are those of geometry."""

import math

import numpy as np
import pytest
import torch
import trimesh
from refusals import refused

from col3d.geometry import (
    Camera,
    FisheyeCamera,
    OmnidirectionalCamera,
    PinholeCamera,
    RadialTangentialCamera,
)
from col3d.inference.fusion import Surface, Volume, compare
from col3d.inference.fusion.volume import projected

RADIUS = 30.0
LENS = OmnidirectionalCamera.c3vd().resized((135, 169))
PINHOLE = PinholeCamera.from_focal((120, 160), 90.0, 90.0, 79.5, 59.5)
FISHEYE = FisheyeCamera.from_focal((120, 160), (70.0, 71.0), (79.5, 59.5), (-0.19, -0.004, 0.03, -0.013))
"""Its image circle ends before the corners."""
DISTORTED = RadialTangentialCamera.from_focal(
    (120, 160), (95.0, 94.0), (79.5, 59.5), (-0.1, 0.01, 0.0, 0.0, 0.0, 0.0), (0.002, -0.001)
)
CAMERAS = {"omnidirectional": LENS, "pinhole": PINHOLE, "fisheye": FISHEYE, "radial_tangential": DISTORTED}


def inside_sphere(camera: Camera, pose: np.ndarray) -> torch.Tensor:
    """Depth (1, h, w) of a sphere about the world's origin, seen from inside it."""
    rays = camera.rays().double().permute(1, 2, 0).numpy() @ pose[:3, :3].T
    start = pose[:3, 3]
    along = rays @ start
    reach = -along + np.sqrt(along**2 - start @ start + RADIUS**2)
    return torch.from_numpy((reach * camera.rays()[2].double().numpy()).astype(np.float32))[None]


def poses() -> list[np.ndarray]:
    """Some that look about from near the middle."""
    found = []
    for turn in (0.0, 0.9, 1.8, 2.7):
        pose = np.eye(4)
        cos, sin = math.cos(turn), math.sin(turn)
        pose[:3, :3] = [[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]]
        pose[:3, 3] = [3.0 * sin, 2.0 - turn, 4.0 * cos]
        found.append(pose)
    return found


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_a_sphere_seen_from_inside(camera: Camera) -> None:
    volume = Volume(0.75)
    image = torch.full((3, *camera.size_hw), 128, dtype=torch.uint8)
    for pose in poses():
        depth = inside_sphere(camera, pose)
        volume.add(depth, depth > 0, image, camera, pose)
    surface = volume.surface()
    off = np.linalg.norm(surface.vertices, axis=1) - RADIUS
    assert len(surface.triangles) > 2000
    assert np.abs(off).mean() < 0.05
    assert np.quantile(np.abs(off), 0.99) < 0.4
    assert surface.colours is not None
    assert np.abs(surface.colours.astype(int) - 128).max() <= 1


def test_masked_pixels_and_frames_without_depth_leave_no_surface() -> None:
    volume = Volume(1.0)
    depth = inside_sphere(PINHOLE, np.eye(4))
    image = torch.zeros(3, 120, 160, dtype=torch.uint8)
    volume.add(depth, torch.zeros_like(depth, dtype=torch.bool), image, PINHOLE, np.eye(4))
    assert len(volume.surface().triangles) == 0
    left = torch.zeros_like(depth, dtype=torch.bool)
    left[..., :60] = True
    volume.add(depth, left, image, PINHOLE, np.eye(4))
    assert volume.surface().vertices[:, 0].max() < 0


def test_a_moved_world_gives_the_moved_surface() -> None:
    """Transform then fuse = fuse then transform, as far as voxels let it be."""
    move = np.eye(4)
    move[:3, 3] = [7.5, -15.0, 22.5]  # whole voxels
    surfaces = []
    for change in (np.eye(4), move):
        volume = Volume(0.75)
        for pose in poses():
            depth = inside_sphere(LENS, pose)
            image = torch.zeros(3, 135, 169, dtype=torch.uint8)
            volume.add(depth, depth > 0, image, LENS, change @ pose)
        surfaces.append(volume.surface())
    moved = Surface(surfaces[0].vertices + move[:3, 3], surfaces[0].triangles)
    distances = compare(surfaces[1], moved, 1.0)
    assert distances.accuracy.max() < 0.05
    assert distances.completeness.mean() < 0.01


def test_the_table_of_directions_projects_as_the_camera_does() -> None:
    points = torch.randn(20000, 3, generator=torch.Generator().manual_seed(0))
    for camera in CAMERAS.values():
        exact, quick = camera.project(points), projected(camera, points)
        height, width = camera.size_hw
        inside = ((exact >= 0) & (exact < exact.new_tensor([width, height]))).all(dim=1)
        assert inside.sum() > 1000
        assert (exact - quick)[inside].abs().max() < 1e-3
        also = ((quick >= 0) & (quick < quick.new_tensor([width, height]))).all(dim=1)
        assert (also == inside).float().mean() > 0.9999


def sphere(radius: float) -> Surface:
    mesh = trimesh.creation.icosphere(subdivisions=5, radius=radius)
    return Surface(np.asarray(mesh.vertices), np.asarray(mesh.faces))


def test_concentric_spheres_are_apart_by_the_difference_of_their_radii() -> None:
    found = compare(sphere(29.0), sphere(30.0), 1.0).summary()
    assert found["accuracy_mean_mm"] == pytest.approx(1.0, abs=0.02)
    assert found["completeness_median_mm"] == pytest.approx(1.0, abs=0.02)
    assert found["f_score_2_mm"] == 1.0
    same = compare(sphere(30.0), sphere(30.0), 1.0)
    assert same.accuracy.max() < 1e-4


def test_half_of_a_surface_is_accurate_and_half_complete() -> None:
    whole = sphere(30.0)
    middle = whole.vertices[whole.triangles].mean(axis=1)
    half = Surface(whole.vertices, whole.triangles[middle[:, 2] < 0])
    found = compare(half, whole, 1.0).summary()
    assert found["accuracy_mean_mm"] < 1e-4
    assert found["complete_within_1_mm"] == pytest.approx(0.5 + 0.5 / 30, abs=0.02)
    seen_half = compare(half, whole, 1.0, half).summary()
    assert seen_half["completeness_mean_mm"] < 1e-4
    with refused(ValueError, "surface", "no triangle"):
        compare(Surface(np.zeros((0, 3)), np.zeros((0, 3), np.int64)), whole, 1.0)
