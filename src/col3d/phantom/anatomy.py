"""Mesh of a procedural colon's wall: a bending tube with folds, bumps and closed ends."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int32

from col3d.phantom.centreline import Centreline, grow_centreline
from col3d.phantom.relief import Fold, bumps, fold_heights, place_folds, pouch, swell, wrinkles
from col3d.phantom.segments import Segment

AROUND = 300
"""Number of vertices in one ring."""
ROW_STEP = 0.55
"""Distance of rings along the tube in mm, away from folds."""
LEAN = 0.25
"""How far folds lean along the tube, relative to their height, so that crests occlude the wall behind."""


@dataclass(frozen=True)
class Colon:
    """A closed mesh whose vertices form rings, with smooth normals into the lumen."""

    vertices: Float32[np.ndarray, "n 3"]
    normals: Float32[np.ndarray, "n 3"]
    triangles: Int32[np.ndarray, "t 3"]
    relief: Float32[np.ndarray, " n"]
    """Height of the wall above the smooth tube, into the lumen, in mm."""
    centreline: Centreline
    segment: Segment


def build_colon(segment: Segment, random: np.random.Generator) -> Colon:
    """Build the mesh of one colon of a family.

    Args:
        segment: the family of shapes.
        random: source of random numbers, which determines this colon.

    Returns:
        A closed mesh in mm.
    """
    centreline = grow_centreline(segment, random)
    folds = place_folds(segment, random)
    rows = _rows(segment, folds)
    theta = np.linspace(0, 2 * np.pi, AROUND, endpoint=False)
    base, inward, lean, radius = _tube(segment, centreline, rows, theta, random)
    height = fold_heights(folds, rows, theta)
    bulges = bumps(segment, rows, theta, radius, random) + swell(segment, base, random)
    if segment.pouch:
        bulges += pouch(rows, theta, segment)
    if segment.wrinkle:
        bulges += wrinkles(segment, rows, theta, random)
    wall = base + (height + bulges)[..., None] * inward + (LEAN * height)[..., None] * lean
    wall[[0, -1]] = wall[[0, -1]].mean(axis=1, keepdims=True)
    return Colon(
        vertices=wall.reshape(-1, 3).astype(np.float32),
        normals=_normals(wall).reshape(-1, 3).astype(np.float32),
        triangles=_triangles(len(rows)),
        relief=(height + bulges).reshape(-1).astype(np.float32),
        centreline=centreline,
        segment=segment,
    )


def _rows(segment: Segment, folds: list[Fold]) -> Float[np.ndarray, " n"]:
    """Positions of rings along the tube, twice as dense at folds; caps lie below 0 and beyond the length."""
    cap = 0.5 * np.pi * segment.radius
    fine = np.arange(-cap, segment.length + cap, 0.1)
    density = np.ones_like(fine)
    for fold in folds:
        density += np.exp(-0.5 * ((fine - fold.at) / 5.0) ** 2)
    count = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * 0.1)]) / ROW_STEP
    return np.interp(np.linspace(0, count[-1], int(count[-1]) + 1), count, fine)


def _tube(
    segment: Segment,
    centreline: Centreline,
    rows: Float[np.ndarray, " n"],
    theta: Float[np.ndarray, " k"],
    random: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Build the smooth tube: points, directions inward and along it (n, k, 3), and radii (n, k)."""
    inside = np.clip(rows, 0, segment.length)
    point, tangent, aside, up = centreline.frames(inside)
    tilt = (rows - inside) / segment.radius
    waves = random.uniform(0, 2 * np.pi, 3)
    calibre = 1 + segment.swing * (np.sin(rows / 31 + waves[0]) + 0.7 * np.sin(rows / 17 + waves[1]))
    twist = waves[2] + 0.6 * np.sin(rows / 70)
    corner = 1 + segment.lobe * np.cos(segment.lobes * (theta[None] - twist[:, None]))
    radius = segment.radius * calibre[:, None] * corner * np.cos(tilt)[:, None]
    outward = np.cos(theta)[:, None] * aside[:, None] + np.sin(theta)[:, None] * up[:, None]
    along = tangent[:, None]
    middle = point + (segment.flatness * segment.radius * np.sin(tilt))[:, None] * tangent
    base = middle[:, None] + radius[..., None] * outward
    inward = -np.cos(tilt)[:, None, None] * outward - np.sin(tilt)[:, None, None] * along
    return base, inward, np.broadcast_to(along, base.shape), radius


def _normals(wall: Float[np.ndarray, "n k 3"]) -> Float[np.ndarray, "n k 3"]:
    """Compute unit normals into the lumen by central differences; all vertices of a pole share one."""
    around = np.roll(wall, -1, axis=1) - np.roll(wall, 1, axis=1)
    along = np.gradient(wall, axis=0)
    normals = np.cross(along, around)
    normals[0], normals[-1] = normals[1].mean(axis=0), normals[-2].mean(axis=0)
    return normals / np.linalg.norm(normals, axis=-1, keepdims=True)


def _triangles(rings: int) -> Int32[np.ndarray, "t 3"]:
    """Make two triangles for each quadrilateral between a ring and the next."""
    corner = np.arange((rings - 1) * AROUND, dtype=np.int32).reshape(rings - 1, AROUND)
    beside = np.roll(corner, -1, axis=1)
    lower = np.stack([corner, beside, corner + AROUND], axis=-1)
    upper = np.stack([beside, beside + AROUND, corner + AROUND], axis=-1)
    return np.stack([lower, upper], axis=2).reshape(-1, 3)
