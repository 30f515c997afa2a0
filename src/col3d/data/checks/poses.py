"""Read the poses of a video from pose.txt, with findings on bad lines."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from col3d.data.checks.findings import Finding
from col3d.data.checks.reproject import Pose
from col3d.data.datasets.pose_files import WANTED, numbers_of, pose_lines
from col3d.data.datasets.release import OFF_ORTHONORMAL, camera_to_world

LAST = np.array([0.0, 0.0, 0.0, 1.0])


def read_poses(path: Path, video: str) -> tuple[dict[int, Pose], int, list[Finding]]:
    """Camera-to-world matrices by frame, the number of lines, and findings on the other lines.

    Args:
        path: path of pose.txt.
        video: name of its video.
    """
    try:
        lines = pose_lines(path)
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
    findings += [_fault(path, video, number, *reasons) for number, reasons in broken.items()]
    return poses, len(lines), findings


def _numbers(line: str) -> np.ndarray | None:
    try:
        row = np.array(numbers_of(line))
    except ValueError:
        return None
    return row if len(row) == WANTED and np.isfinite(row).all() else None


def _matrices(rows: Mapping[int, np.ndarray]) -> tuple[dict[int, Pose], dict[int, tuple[str, str]]]:
    """The matrices that are poses, all written the same way, and why the others are not."""
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


def _fault(path: Path, video: str, number: int, rule: str, actual: str) -> Finding:
    return Finding(
        "poses", f"{path}: line {number + 1}, of frame {number}: {rule}, got {actual}", video, number
    )
