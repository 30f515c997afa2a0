"""Centreline of the tube."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from col3d.phantom.segments import Segment


@dataclass(frozen=True)
class Centreline:
    """The centreline by arc length in mm from the blind end, with an upright frame across it."""

    at: Float[np.ndarray, " n"]
    points: Float[np.ndarray, "n 3"]
    yaw: Float[np.ndarray, " n"]
    pitch: Float[np.ndarray, " n"]

    def frames(self, s: Float[np.ndarray, " k"]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return points, tangents (away from the blind end) and two unit normals, each (k, 3), at `s` mm."""
        point = np.stack([np.interp(s, self.at, self.points[:, i]) for i in range(3)], axis=-1)
        yaw, pitch = np.interp(s, self.at, self.yaw), np.interp(s, self.at, self.pitch)
        zero = np.zeros_like(yaw)
        tangent = np.stack([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)], axis=-1)
        aside = np.stack([-np.sin(yaw), np.cos(yaw), zero], axis=-1)
        return point, tangent, aside, np.cross(tangent, aside)


def grow_centreline(segment: Segment, random: np.random.Generator) -> Centreline:
    """Draw a centreline whose direction oscillates like a sine: it meanders without self-intersection."""
    at = np.arange(0.0, segment.length + 0.5, 0.5)
    phase, lift, period = (
        random.uniform(0, 2 * np.pi),
        random.uniform(0, 2 * np.pi),
        random.uniform(0.9, 1.15),
    )
    turn = 2 * np.pi * at / (segment.bend_length * period)
    yaw = segment.bend * np.sin(turn + phase)
    pitch = 0.35 * segment.bend * np.sin(0.83 * turn + lift)
    tangent = np.stack([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)], axis=-1)
    middle = 0.5 * (tangent[1:] + tangent[:-1]) * np.diff(at)[:, None]
    points = np.concatenate([np.zeros((1, 3)), np.cumsum(middle, axis=0)])
    return Centreline(at, points, yaw, pitch)
