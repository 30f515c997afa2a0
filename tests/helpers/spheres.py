"""A sphere seen from inside by a moving camera, known in closed form."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from col3d.data.checks import VideoReport
from col3d.data.datasets.octagon import octagon_mask
from col3d.geometry import OmnidirectionalCamera

SIZE = (108, 135)
LENS = OmnidirectionalCamera.c3vd().resized(SIZE)
RADIUS = 30.0
FOCAL = (76.98074036881, 76.97205585342)
MIDDLE = ((675.226397736271 + 0.5) / 10 - 0.5, (548.903474592445 + 0.5) / 10 - 0.5)
"""Of the pinhole in published code, at a tenth of its size."""
Write = Callable[..., Path]
Check = Callable[..., VideoReport]
Channels = tuple[tuple[int, int], ...]
"""What red, green and blue hold: axis and sign."""


def pose_of(number: int) -> np.ndarray:
    """Camera to world: slowly to and fro beside the middle of the sphere."""
    turn, bend = 0.03 * number, 0.4 + 0.01 * number
    around = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    aside = np.array([[np.cos(bend), 0, np.sin(bend)], [0, 1, 0], [-np.sin(bend), 0, np.cos(bend)]])
    pose = np.eye(4)
    pose[:3, :3] = around @ aside
    pose[:3, 3] = [5 + 4 * np.sin(number / 10), -4 + 4 * np.sin(number / 20), 3 - 4 * np.sin(number / 10)]
    return pose


def see(pose: np.ndarray, camera: OmnidirectionalCamera = LENS) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Depth (h, w) in mm and normals (h, w, 3) in camera axes, and where the octagon shows them."""
    rays = camera.rays().permute(1, 2, 0).double().numpy()
    turn, place = pose[:3, :3], pose[:3, 3]
    world = rays @ turn.T
    along = world @ place
    distance = -along + np.sqrt(along**2 - place @ place + RADIUS**2)
    normals = -(place + distance[..., None] * world) / RADIUS
    return distance * rays[..., 2], normals @ turn, octagon_mask(camera.size_hw)[0].numpy()


def pinhole_normals(depth: np.ndarray) -> np.ndarray:
    """As published code makes them: of the depth, as if a pinhole had seen it."""
    v, u = np.mgrid[: SIZE[0], : SIZE[1]].astype(float)
    points = np.stack(
        [(u - MIDDLE[0]) / FOCAL[0] * depth, (v - MIDDLE[1]) / FOCAL[1] * depth, depth], axis=-1
    )
    normals = np.cross(np.gradient(points, axis=0), np.gradient(points, axis=1))
    return normals / np.linalg.norm(normals, axis=-1, keepdims=True)


def stored(normals: np.ndarray, channels: Channels, clipped: bool) -> np.ndarray:
    """16-bit codes of normals; `clipped` stores z in 0..1 and cuts off what is negative."""
    held = [sign * normals[..., axis] for axis, sign in channels]
    parts = [
        np.maximum(value, 0) if clipped and axis == 2 else (value + 1) / 2
        for value, (axis, _) in zip(held, channels, strict=True)
    ]
    return np.rint(np.stack(parts, axis=-1) * 65535).astype(np.uint16)


CURRENT: Channels = ((0, 1), (1, 1), (2, 1))
OLD: Channels = ((0, 1), (1, -1), (2, -1))


def write_poses(path: Path, poses: Sequence[np.ndarray]) -> None:
    """As the current release has them: the transpose, a line each."""
    np.savetxt(path, np.stack(poses).transpose(0, 2, 1).reshape(-1, 16), delimiter=",", fmt="%.9g")


def faults(report: VideoReport) -> list[tuple[str, int | None]]:
    """Rule and frame of each."""
    return [(finding.rule, finding.frame) for finding in report.findings if finding.fault]


def said(report: VideoReport) -> str:
    return "\n".join(finding.text for finding in report.findings)
