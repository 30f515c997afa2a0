"""Laws between the frames of a phantom: flow, occlusion, poses and coverage tell of one and the same wall."""

from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from col3d.data.datasets.coverage_mesh import read_coverage_mesh
from col3d.data.datasets.octagon import octagon_mask
from col3d.phantom import PhantomSettings, phantom_camera, render_phantom
from col3d.phantom.anatomy import AROUND
from col3d.phantom.coverage import BLOCK
from col3d.phantom.write import Scene, scene_of

VIDEO, FRAMES = "sigmoid_t2_a", range(48)
SOME = FRAMES[1::6]
OFFSET = 1e-2
"""Distance in mm behind a surface at which a second cast starts."""


@pytest.fixture(scope="module")
def slow(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Scene, PhantomSettings]:
    """So many frames that steps are of a millimetre, and most motions of less than 20 pixels."""
    settings = PhantomSettings(size_hw=(135, 169), frames_per_video=len(FRAMES), videos=(VIDEO,))
    root = tmp_path_factory.mktemp("slow") / "phantom"
    render_phantom(root, settings, workers=1, progress=False)
    return root / VIDEO, scene_of(VIDEO, settings), settings


def pixels(path: Path) -> np.ndarray:
    return cv2.imread(str(path), cv2.IMREAD_UNCHANGED)


def flow_of(folder: Path, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Motion in pixels (h, w, 2), and where it is known."""
    codes = pixels(folder / f"{number:04d}_flow.tiff")[..., ::-1]
    assert codes.dtype == np.uint16
    assert (codes[..., 2] == 0).all()
    known = ((codes[..., :2] > 0) & (codes[..., :2] < 65535)).all(axis=-1)
    return codes[..., :2] / 65535.0 * 40 - 20, known


def landing(scene: Scene, settings: PhantomSettings, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Where a frame's points lie in the frame before: pixels (h, w, 2) and camera axes (h, w, 3)."""
    camera, shown = phantom_camera(settings), octagon_mask(settings.size_hw)[0].numpy()
    hits = scene.renderer.cast(scene.poses[number])
    before = scene.poses[number - 1]
    points = (hits.world.astype(np.float64) - before[:3, 3]) @ before[:3, :3]
    places = camera.project(torch.from_numpy(points)).numpy()
    grid, axes = (np.full((*shown.shape, size), np.nan) for size in (2, 3))
    grid[shown], axes[shown] = places, points
    return grid, axes


def distance_and_wall(scene: Scene, number: int, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far points in camera axes are, and how far the wall is that a frame sees towards them, in mm."""
    distance, pose = np.linalg.norm(points, axis=1), scene.poses[number]
    way = ((points / distance[:, None]) @ pose[:3, :3].T).astype(np.float32)
    start = np.broadcast_to(pose[:3, 3], way.shape).astype(np.float32)
    found = scene.renderer.scene.run(np.ascontiguousarray(start), np.ascontiguousarray(way), output=True)
    return distance, found["tfar"]


@pytest.mark.parametrize("number", SOME)
def test_flow_moves_a_pixel_onto_the_same_point(
    slow: tuple[Path, Scene, PhantomSettings], number: int
) -> None:
    folder, scene, settings = slow
    flow, known = flow_of(folder, number)
    assert known.mean() > 0.5
    places, _ = landing(scene, settings, number)
    rows, columns = np.indices(known.shape)
    moved = np.stack([columns, rows], axis=-1) + flow
    assert np.abs(moved - places)[known].max() < 0.1
    height, width = known.shape
    assert (moved[known] > -0.01).all()
    assert (moved[known] < (width, height)).all()


@pytest.mark.parametrize("number", SOME)
def test_flow_depth_and_poses_on_disk_tell_of_one_motion(
    slow: tuple[Path, Scene, PhantomSettings], number: int
) -> None:
    folder, _, settings = slow
    camera, (flow, known) = phantom_camera(settings), flow_of(folder, number)
    depth = pixels(folder / f"{number:04d}_depth.tiff") / 65535.0 * 100
    poses = np.loadtxt(folder / "pose.txt", delimiter=",").reshape(-1, 4, 4)
    rays = camera.rays().numpy()
    points = np.moveaxis(rays / rays[2] * depth, 0, -1)[known & (depth < 100)]
    to_before = poses[number] @ np.linalg.inv(poses[number - 1])  # p_world = [p, 1] @ M
    moved = points @ to_before[:3, :3] + to_before[3, :3]
    rows, columns = np.indices(known.shape)
    here = np.stack([columns, rows], axis=-1)[known & (depth < 100)]
    there = camera.project(torch.from_numpy(moved)).numpy()
    assert np.abs(there - here - flow[known & (depth < 100)]).max() < 0.1


@pytest.mark.parametrize("number", SOME)
def test_flow_is_known_where_the_frame_before_sees_the_point_and_nowhere_else(
    slow: tuple[Path, Scene, PhantomSettings], number: int
) -> None:
    folder, scene, settings = slow
    _, known = flow_of(folder, number)
    places, points = landing(scene, settings, number)
    rows, columns = np.indices(known.shape)
    motion = places - np.stack([columns, rows], axis=-1)
    height, width = known.shape
    with np.errstate(invalid="ignore"):
        inside = (np.abs(motion) < 19.9).all(axis=-1) & (places > 1).all(axis=-1)
        inside &= (places < (width - 2, height - 2)).all(axis=-1)
    distance, first = distance_and_wall(scene, number - 1, points[inside])
    clear, hidden = distance - first < 0.05, distance - first > 0.2
    assert known[inside][clear].mean() > 0.999
    assert not known[inside][hidden].any()
    assert not known[~octagon_mask(settings.size_hw)[0].numpy()].any()


def test_the_first_frame_has_no_flow(slow: tuple[Path, Scene, PhantomSettings]) -> None:
    assert not (slow[0] / "0000_flow.tiff").exists()


@pytest.mark.parametrize("number", SOME)
def test_occlusion_agrees_with_a_second_cast(slow: tuple[Path, Scene, PhantomSettings], number: int) -> None:
    folder, scene, settings = slow
    shown = octagon_mask(settings.size_hw)[0].numpy()
    said = pixels(folder / f"{number:04d}_occlusion.png")
    assert set(np.unique(said)) <= {0, 255}
    hits = scene.renderer.cast(scene.poses[number])
    rays = (hits.world - scene.poses[number][:3, 3]).astype(np.float64)
    distance = np.linalg.norm(rays, axis=1)
    rays /= distance[:, None]
    found = scene.renderer.scene.run(
        (hits.world + OFFSET * rays).astype(np.float32), rays.astype(np.float32), output=True
    )
    along = scene.renderer.rays[:, 2]  # depth of the second surface, not its distance
    behind = (found["primID"] >= 0) & ((distance + OFFSET + found["tfar"]) * along <= 100)
    assert (said[shown].astype(bool) == behind).mean() > 0.998
    assert behind.any()
    assert not said[~shown].any()


def test_poses_reproject_the_depth(slow: tuple[Path, Scene, PhantomSettings]) -> None:
    """Depth of one frame carried into the next lies on the wall that the next one's rays meet there."""
    folder, scene, settings = slow
    camera, shown = phantom_camera(settings), octagon_mask(settings.size_hw)[0].numpy()
    rays = camera.rays().numpy()[:, shown].T
    rows = np.loadtxt(folder / "pose.txt", delimiter=",").reshape(-1, 4, 4)
    for first, second in pairwise(SOME):
        depth = pixels(folder / f"{first:04d}_depth.tiff")[shown] / 65535.0 * 100
        points = np.concatenate([rays / rays[:, 2:] * depth[:, None], np.ones((len(depth), 1))], axis=1)
        seen = (points @ rows[first] @ np.linalg.inv(rows[second]))[:, :3]
        distance, met = distance_and_wall(scene, second, seen)
        off = np.abs(distance - met)[(depth < 100) & (distance - met < 1)]  # others are hidden
        assert len(off) > 0.3 * len(depth)
        assert np.median(off) < 0.05


def test_coverage_is_the_union_of_the_faces_that_were_hit(slow: tuple[Path, Scene, PhantomSettings]) -> None:
    folder, scene, _ = slow
    read = read_coverage_mesh(folder / "coverage_mesh.obj")
    colon = scene.renderer.colon
    hit = np.unique(np.concatenate([scene.renderer.cast(pose).triangle for pose in scene.poses]))
    ring, place = np.divmod(colon.triangles[hit[hit >= 0]], AROUND)
    across = np.ptp(place, axis=1) > 1  # from the last column to the first
    column = np.where(across, AROUND - 1, place.min(axis=1))
    blocks = set(zip(ring.min(axis=1) // BLOCK, column // BLOCK, strict=True))
    first = read.seen[:, 0]
    assert read.observed is not None
    assert set(zip(*np.divmod(first, AROUND // BLOCK), strict=True)) == blocks
    assert len(read.seen) == 2 * len(blocks) < len(read.triangles)
    text = (folder / "coverage_mesh.obj").read_text().splitlines()
    assert [line for line in text if line.startswith("vt")] == ["vt 0.0 0.0", "vt 1.0 1.0"]
    assert {line.split()[0] for line in text} == {"v", "vt", "f"}


def test_what_the_frames_see_lies_on_seen_faces(slow: tuple[Path, Scene, PhantomSettings]) -> None:
    folder, scene, _ = slow
    read = read_coverage_mesh(folder / "coverage_mesh.obj")
    middles = read.vertices[read.seen].mean(axis=1)
    world = scene.renderer.cast(scene.poses[3]).world[::97]
    nearest = np.array([np.linalg.norm(middles - point, axis=1).min() for point in world])
    assert np.quantile(nearest, 0.99) < 3.0
