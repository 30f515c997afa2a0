"""Trajectory of the endoscope: withdrawal along the centreline with sway, pan and roll."""

import numpy as np
from jaxtyping import Float, Float64

from col3d.phantom.anatomy import Colon

CLEARANCE = 4.5
"""Least distance in mm from the lens to the wall; if folds leave less room, the centreline is taken."""
AHEAD = 22.0
"""Distance in mm along the centreline to the point that the endoscope faces."""
SWAY = 0.55
"""Largest distance from the centreline relative to the radius, before it is reduced for clearance."""


def camera_poses(
    colon: Colon, frames: int, random: np.random.Generator, free: bool = False
) -> Float64[np.ndarray, "n 4 4"]:
    """Draw camera-to-world poses along one withdrawal.

    Args:
        colon: the colon.
        frames: number of frames; the length of the trajectory does not depend on it.
        random: source of random numbers, which determines this trajectory.
        free: also draw the length, the sway and the pan, so that the view may come close to the wall.

    Returns:
        [[R, t], [0, 1]] with p_world = R p + t in mm, facing the blind end apart from the pan.
    """
    travel = random.uniform(25, 75) if free else random.uniform(40, 60)
    last_start = (45.0 if free else 22.0) if colon.segment.pouch else colon.segment.length - travel - 20
    widths = (random.uniform(0.3, 1.4, 2), random.uniform(0.2, 1.4)) if free else (np.ones(2), 1.0)
    at = random.uniform(4.0 if colon.segment.pouch else 45.0, last_start) + travel * np.linspace(0, 1, frames)
    phase = random.uniform(0, 2 * np.pi, 5)
    pan = np.stack(
        [
            widths[0][0] * random.uniform(0.3, 0.75) * np.sin(at / 9 + phase[0]),
            widths[0][1] * random.uniform(0.2, 0.55) * np.sin(at / 7 + phase[1]),
        ]
    )
    roll = phase[2] + 0.4 * np.sin(at / 25 + phase[2])
    sway = (
        widths[1]
        * colon.segment.radius
        * SWAY
        * np.stack([np.sin(at / 13 + phase[3]), np.sin(at / 17 + phase[4])])
    )
    position = _clear_positions(colon, at, sway)
    target, tangent, _, up = colon.centreline.frames(at - AHEAD)
    target = target - np.clip(AHEAD - at, 0, None)[:, None] * tangent
    poses = np.tile(np.eye(4), (frames, 1, 1))
    poses[:, :3, :3] = _look(target - position, up) @ _turn(pan, roll)
    poses[:, :3, 3] = position
    return poses


def _clear_positions(
    colon: Colon, at: Float[np.ndarray, " n"], sway: Float[np.ndarray, "2 n"]
) -> Float[np.ndarray, "n 3"]:
    """Compute positions beside the centreline; their sway is reduced until all are clear of the wall."""
    point, _, aside, up = colon.centreline.frames(at)
    wall = colon.vertices[::3]
    for part in (1.0, 0.8, 0.6, 0.4, 0.2, 0.0):
        position = point + part * (sway[0][:, None] * aside + sway[1][:, None] * up)
        if all(_distance(wall, p) >= CLEARANCE for p in position):
            break
    return position


def _distance(wall: Float[np.ndarray, "v 3"], position: Float[np.ndarray, " 3"]) -> float:
    off = wall - position.astype(wall.dtype)
    return float(np.sqrt(np.einsum("vi,vi->v", off, off).min()))


def _look(forward: Float[np.ndarray, "n 3"], up: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 3"]:
    """Make rotations whose third column points forward and whose second points away from `up`."""
    z = forward / np.linalg.norm(forward, axis=-1, keepdims=True)
    x = np.cross(z, up)
    x /= np.linalg.norm(x, axis=-1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=-1)


def _turn(pan: Float[np.ndarray, "2 n"], roll: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3 3"]:
    """Make rotations about the camera's own axes y and x (radians), then about its optical axis."""
    return _about(1, pan[0]) @ _about(0, pan[1]) @ _about(2, roll)


def _about(axis: int, angle: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3 3"]:
    turn = np.tile(np.eye(3), (len(angle), 1, 1))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turn[:, i, i] = turn[:, j, j] = np.cos(angle)
    turn[:, j, i] = np.sin(angle)
    turn[:, i, j] = -turn[:, j, i]
    return turn
