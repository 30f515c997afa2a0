"""Poses of a video: the lines of pose.txt, and whether they carry the depth of one frame into the next."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float64

from col3d.data.frames import Depth
from col3d.data.release import OFF_ORTHONORMAL, camera_to_world
from col3d.data.verify.findings import NAN, Finding, Reprojection
from col3d.geometry import Camera

Pose = Float64[np.ndarray, "4 4"]
LAST = np.array([0.0, 0.0, 0.0, 1.0])
SPACING = 108
"""Rows of points that are carried over."""
ENOUGH_SEEN = 0.05
"""Share of the points that both frames see, below which nothing is compared."""


def read_poses(path: Path, video: str) -> tuple[dict[int, Pose], int, list[Finding]]:
    """Camera-to-world matrices by frame, how many lines there are, and what is wrong with others.

    Args:
        path: of pose.txt.
        video: that it is of.
    """
    try:
        lines = path.read_text(encoding="utf-8").rstrip().splitlines()
    except (OSError, ValueError) as error:
        return {}, 0, [Finding("poses", f"{path}: cannot be read ({error})", video)]
    rows, findings = {}, []
    for number, line in enumerate(lines):
        row = _numbers(line)
        if row is None:
            findings.append(_fault(path, video, number, "expected 16 comma-separated numbers", line[:60]))
        else:
            rows[number] = row
    poses, broken = _matrices(rows)
    findings += [_fault(path, video, number, *what) for number, what in broken.items()]
    return poses, len(lines), findings


def reproject(first: Depth, second: Depth, poses: tuple[Pose, Pose], camera: Camera, to: int) -> Reprojection:
    """Lift points of one frame, move them by the poses, and compare with the depth that the other has there.

    Args:
        first: depth of the one frame.
        second: of the other.
        poses: camera to world of both.
        camera: that took them.
        to: number of the other frame.
    """
    points = _lifted(first, camera)
    second_from_first = np.linalg.inv(poses[1]) @ poses[0]
    step = float(np.linalg.norm(second_from_first[:3, 3]))
    moved = second_from_first @ np.concatenate([points, np.ones_like(points[:1])])
    pixels = camera.project(torch.from_numpy(moved[:3].T.copy())).numpy()
    there, seen = _between(second, pixels)
    share = float(np.count_nonzero(seen) / max(1, points.shape[1]))
    if share < ENOUGH_SEEN:
        return Reprojection(to, step, share, NAN, NAN)
    tenth, median = np.quantile(np.abs(there - moved[2])[seen], [0.1, 0.5])
    return Reprojection(to, step, share, float(median), float(tenth))


def _numbers(line: str) -> np.ndarray | None:
    try:
        row = np.array([float(number) for number in line.split(",")])
    except ValueError:
        return None
    return row if len(row) == 16 and np.isfinite(row).all() else None


def _matrices(rows: Mapping[int, np.ndarray]) -> tuple[dict[int, Pose], dict[int, tuple[str, str]]]:
    """Those that are poses, all written the same way, and why others are not."""
    if not rows:
        return {}, {}
    whole = np.stack(list(rows.values())).reshape(-1, 4, 4)
    ways = [np.isclose(side, LAST, atol=1e-6).all(axis=1) for side in (whole[:, :, 3], whole[:, 3, :])]
    way = ways[0] if ways[0].sum() >= ways[1].sum() else ways[1]
    poses, broken = {}, {}
    for number, matrix, fits in zip(rows, whole, way, strict=True):
        rotation = matrix[:3, :3]
        off = np.abs(rotation @ rotation.T - np.eye(3)).max()
        if not fits:
            broken[number] = ("expected (0, 0, 0, 1) where the other poses have it", "none there")
        elif off > OFF_ORTHONORMAL:
            broken[number] = ("expected an orthonormal rotation", f"one that is off by {off:.3g}")
        elif np.linalg.det(rotation) < 0:
            broken[number] = ("expected a rotation of determinant 1", "one that mirrors, of -1")
        else:
            poses[number] = matrix
    if poses:
        turned = camera_to_world(np.stack(list(poses.values())).reshape(-1, 16))
        poses = dict(zip(poses, turned, strict=True))
    return poses, broken


def _fault(path: Path, video: str, number: int, rule: str, came: str) -> Finding:
    return Finding(
        "poses", f"{path}: line {number + 1}, of frame {number}: {rule}, got {came}", video, number
    )


def _lifted(depth: Depth, camera: Camera) -> np.ndarray:
    """Points (3, n) in camera axes, on a grid of pixels."""
    step = max(1, camera.size_hw[0] // SPACING)
    grid = np.s_[step // 2 :: step, step // 2 :: step]
    known = depth.known[grid]
    rays = camera.rays().numpy()[:, *grid][:, known].astype(np.float64)
    return rays / rays[2] * depth.mm[grid][known]


def _between(depth: Depth, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Depth between the four pixels around (u, v), and where all four are known."""
    height, width = depth.mm.shape
    inside = np.isfinite(pixels).all(axis=1) & (pixels >= 0).all(axis=1)
    inside &= (np.nan_to_num(pixels) < [width - 1, height - 1]).all(axis=1)
    safe = np.where(inside[:, None], pixels, 0.0)
    u, v = np.floor(safe).astype(np.int64).T
    across, down = (safe - np.floor(safe)).T
    there, seen = np.zeros(len(pixels)), inside
    for row, column in ((0, 0), (0, 1), (1, 0), (1, 1)):
        weight = (down if row else 1 - down) * (across if column else 1 - across)
        there += weight * np.nan_to_num(depth.mm[v + row, u + column])
        seen = seen & depth.known[v + row, u + column]
    return there, seen
