"""Carry depth of one frame into another by their poses, and compare it with the depth there."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float64

from col3d.data.checks.findings import NAN, Reprojection
from col3d.data.datasets.frame_set import Depth
from col3d.geometry import Camera

Pose = Float64[np.ndarray, "4 4"]
SPACING = 108
"""Rows of points that are carried over: every tenth row and column of a frame of C3VD."""
ENOUGH_SEEN = 0.05
"""Share of the points that both frames see, below which nothing is compared."""
FLAT = 1e-4
"""Bend of the depth between four pixels, as a share of it, beyond which an edge lies between them."""
HIDDEN = 0.01
"""Share of the depth by which a point lies behind the surface of the other frame where it is hidden there."""


@dataclass(frozen=True)
class Carried:
    """Points of one frame in the other; only those that fall between four of its pixels of known depth.

    Attributes:
        points: number of points of the one frame.
        z: their depth in the other camera, in mm.
        surface_z: depth of the other frame, interpolated between the four pixels, in mm.
        bend: bend of the depth of the four, which is 0 where they lie on one plane.
    """

    points: int
    z: Float64[np.ndarray, " n"]
    surface_z: Float64[np.ndarray, " n"]
    bend: Float64[np.ndarray, " n"]

    @property
    def seen(self) -> float:
        """Share of the points that the other frame sees too."""
        return len(self.z) / max(1, self.points)


def carry(first: Depth, second: Depth, poses: tuple[Pose, Pose], camera: Camera) -> Carried:
    """Lift points of one frame, on a grid of its pixels, and move them into the other.

    Args:
        first: depth of the one frame.
        second: depth of the other.
        poses: camera-to-world matrices of both.
        camera: camera of both frames.
    """
    _, points = _lifted(first, camera)
    moved, pixels = _moved(points, poses, camera)
    surface_z, bend, seen = _between(second, pixels)
    return Carried(points.shape[1], moved[2][seen], surface_z[seen], bend[seen])


def reproject(first: Depth, second: Depth, poses: tuple[Pose, Pose], camera: Camera, to: int) -> Reprojection:
    """Compare carried depth with that of the other frame, over all points that fall into it.

    Args:
        first: depth of the one frame.
        second: depth of the other.
        poses: camera-to-world matrices of both.
        camera: camera of both frames.
        to: number of the other frame.
    """
    step = float(np.linalg.norm((np.linalg.inv(poses[1]) @ poses[0])[:3, 3]))
    carried = carry(first, second, poses, camera)
    if carried.seen < ENOUGH_SEEN:
        return Reprojection(to, step, carried.seen, NAN, NAN)
    tenth, median = np.quantile(np.abs(carried.surface_z - carried.z), [0.1, 0.5])
    return Reprojection(to, step, carried.seen, float(median), float(tenth))


def surface_error(first: Depth, second: Depth, poses: tuple[Pose, Pose], camera: Camera) -> float:
    """Median |z - depth there| in mm over points on one smooth surface that both frames see.

    Points between pixels with an edge between them are left out, for there depth cannot be interpolated, and
    so are points behind the surface of the other frame, which hides them. NaN where too few are left.
    """
    carried = carry(first, second, poses, camera)
    kept: Bool[np.ndarray, " n"] = carried.bend <= FLAT * carried.surface_z
    kept &= carried.z <= (1 + HIDDEN) * carried.surface_z
    if np.count_nonzero(kept) < ENOUGH_SEEN * max(1, carried.points):
        return NAN
    return float(np.median(np.abs(carried.z - carried.surface_z)[kept]))


def flow_error(
    depth: Depth, flow: np.ndarray, known: np.ndarray, poses: tuple[Pose, Pose], camera: Camera
) -> float:
    """Median distance in pixels between stored flow and the motion that depth and poses imply.

    Args:
        depth: depth of a frame.
        flow: (h, w, 2), where its pixels were in the frame before, minus where they are.
        known: where flow is known.
        poses: camera-to-world matrices of the frame, and of the one before.
        camera: camera of both frames.

    Returns:
        The distance; NaN where too little is known.
    """
    pixels, points = _lifted(depth, camera)
    u, v = pixels.T.astype(int)
    compared = known[v, u]
    if np.count_nonzero(compared) < ENOUGH_SEEN * max(1, len(pixels)):
        return NAN
    _, before = _moved(points[:, compared], poses, camera)
    motion = before - pixels[compared]
    return float(np.median(np.linalg.norm(flow[v, u][compared] - motion, axis=1)))


def _moved(
    points: Float64[np.ndarray, "3 n"], poses: tuple[Pose, Pose], camera: Camera
) -> tuple[np.ndarray, np.ndarray]:
    """Points of one camera in the other's axes (3, n), and the pixels at which it sees them (n, 2)."""
    second_from_first = np.linalg.inv(poses[1]) @ poses[0]
    moved = second_from_first[:3, :3] @ points + second_from_first[:3, 3:]
    return moved, camera.project(torch.from_numpy(moved.T.copy())).numpy()


def _lifted(depth: Depth, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (n, 2) of a grid, and their points (3, n) in camera axes."""
    step = max(1, camera.size_hw[0] // SPACING)
    v, u = np.mgrid[tuple(slice(step // 2, side, step) for side in camera.size_hw)]
    known = depth.known[v, u] & camera.sees()[0].numpy()[v, u]
    pixels = np.stack([u[known], v[known]], axis=1).astype(np.float64)
    rays = camera.unproject(torch.from_numpy(pixels)).numpy().T
    return pixels, rays / rays[2] * depth.mm[v, u][known]


def _between(depth: Depth, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Depth between the four pixels around (u, v), their bend, and where all four are known."""
    height, width = depth.mm.shape
    inside = np.isfinite(pixels).all(axis=1) & (pixels >= 0).all(axis=1)
    inside &= (np.nan_to_num(pixels) < [width - 1, height - 1]).all(axis=1)
    safe = np.where(inside[:, None], pixels, 0.0)
    u, v = np.floor(safe).astype(np.int64).T
    across, down = (safe - np.floor(safe)).T
    surface_z, bend, seen = np.zeros(len(pixels)), np.zeros(len(pixels)), inside
    for row, column in ((0, 0), (0, 1), (1, 0), (1, 1)):
        weight = (down if row else 1 - down) * (across if column else 1 - across)
        mm = np.nan_to_num(depth.mm[v + row, u + column]).astype(np.float64)
        surface_z += weight * mm
        bend += mm if row == column else -mm
        seen = seen & depth.known[v + row, u + column]
    return surface_z, np.abs(bend), seen
