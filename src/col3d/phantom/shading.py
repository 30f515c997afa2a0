"""Shading of the wall: mucosa, vessels, mucus, bubbles and wet highlights under two lamps."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import cv2
import numpy as np
from jaxtyping import Float, Float32

from col3d.phantom.anatomy import Colon
from col3d.phantom.appearance import Colour, Light, Tissue
from col3d.phantom.texture import FineTexture, axis_shares
from col3d.phantom.value_noise import random_lattice, smoothstep, value_noise

THIN = 3 / 7
"""Size of the pattern of capillaries relative to that of vessels."""
REFERENCE = 20.0
"""Distance in mm for which scattered light is given relative to that of the lamps."""

Vectors = Float32[np.ndarray, "n 3"]
Scalars = Float32[np.ndarray, " n"]
Attributes = Float32[np.ndarray, "n 8"]
"""Signed distances in mm to two vessels and two capillaries, patches, tone, density of vessels, relief."""


@dataclass(frozen=True)
class Hits:
    """Points where the rays of a frame hit the wall, in camera axes and mm, with attributes of the wall."""

    points: Vectors
    normals: Vectors
    world: Vectors
    facing: Vectors
    """Interpolated normals in world axes, for the textures; not of unit length."""
    attributes: Attributes
    vertex: np.ndarray
    """Index of a vertex near each point."""
    triangle: np.ndarray
    """Index of the triangle; -1 where a ray hits none."""
    turn: Float32[np.ndarray, "3 3"]
    """Rotation from camera axes to world axes, shared by all points."""

    def band(self, rows: slice | np.ndarray) -> "Hits":
        """Select some of the points."""
        return replace(self, **{name: getattr(self, name)[rows] for name in self._of_points()})

    @classmethod
    def joined(cls, bands: Sequence["Hits"]) -> "Hits":
        """Concatenate the points of several bands of one frame, in order."""
        whole = {name: np.concatenate([getattr(b, name) for b in bands]) for name in cls._of_points()}
        return replace(bands[0], **whole)

    @classmethod
    def _of_points(cls) -> list[str]:
        return [field.name for field in fields(cls) if field.name != "turn"]


@dataclass(frozen=True)
class Radiance:
    """Components of the linear light that reaches the lens: scattered by the wall, mirrored by its film."""

    albedo: Vectors
    diffuse: Scalars
    scattered: Scalars
    mirrored: Scalars

    @classmethod
    def joined(cls, bands: Sequence["Radiance"]) -> "Radiance":
        """Concatenate the light of several bands of one frame, in order."""
        return cls(*(np.concatenate([getattr(b, field.name) for b in bands]) for field in fields(cls)))


class Mucosa:
    """The surface of one colon: slow variation is stored at its vertices, fine variation computed at points.

    Args:
        colon: the wall.
        tissue: its texture.
        random: source of random numbers, which determines this surface among those of the texture.
    """

    def __init__(self, colon: Colon, tissue: Tissue, random: np.random.Generator) -> None:
        self.tissue = tissue
        unit, spacing = tissue.patch_size / 16, tissue.vessel_spacing
        warp = value_noise(colon.vertices, 7 * unit, random_lattice(random, 3)) * np.float32(unit)
        slow = value_noise(colon.vertices + 3 * warp, 16 * unit, random_lattice(random, 3))
        quick = value_noise(colon.vertices + 1.5 * warp, 5 * unit, random_lattice(random, 1))
        vessels = _winding_lines(colon, spacing, random), _winding_lines(colon, THIN * spacing, random)
        columns = [*vessels, slow[:, :1] + 0.6 * quick, slow[:, 1:], colon.relief[:, None]]
        self.attributes: Float32[np.ndarray, "v 8"] = np.concatenate(columns, axis=1)
        sizes = tissue.grain_size, tissue.film_size
        self._grain, self._film = (FineTexture(size, 3, random) for size in sizes)
        self._bubbles = _bubbles(colon, tissue, random)
        self._bubble_at = _nearby(colon, self._bubbles)

    def radiance(self, hits: Hits, light: Light, lit: Float32[np.ndarray, "n k"], pixel: float) -> Radiance:
        """Compute the light that reaches the lens.

        Args:
            hits: the visible points of the wall.
            light: lamps, and light scattered by the rest of the wall.
            lit: share of each of the k lamps that reaches each point, 0 in its shadow.
            pixel: angle between neighbouring pixels in radians.
        """
        look, shares = self.tissue, axis_shares(hits.facing)
        grain, film = self._grain(hits.world, shares), self._film(hits.world + 0.3, shares)
        distance = np.sqrt(_dot(hits.points, hits.points))
        ripple_pixels = look.film_size / (pixel * distance)
        visible = np.clip(ripple_pixels, 0.25, 1.0)[:, None]  # ripples under a pixel average out
        to_camera = np.ascontiguousarray(hits.turn.T)  # grain and film are fixed to the wall
        bent, rippled = (cv2.transform(field[None], to_camera)[0] for field in (grain, film))
        tissue = _unit(hits.normals + 0.5 * look.roughness * bent)
        wet = _unit(tissue + 1.6 * look.roughness * visible * rippled + self._domes(hits))
        diffuse, shine = _lamplight(hits.points, tissue, wet, distance, light, lit, look)
        scattered = light.scatter * REFERENCE ** (light.scatter_fall - 2) / distance**light.scatter_fall
        gloss = look.gloss * smoothstep(-1.0, 0.8, hits.attributes[:, 4] + 0.5 * grain[:, 2])
        return Radiance(
            self._albedo(hits.attributes, grain), diffuse, scattered.astype(np.float32), gloss * shine
        )

    def _albedo(self, attributes: Attributes, grain: Vectors) -> Vectors:
        """Compute the linear reflectance of points with these attributes and this grain."""
        look, (patches, tone, density, relief) = self.tissue, attributes[:, 4:].T
        part = smoothstep(0.0, 0.8, patches + 0.15 * grain[:, 0])
        colour = _mix(np.asarray(look.mucosa, np.float32), look.patches, look.patchiness * part)
        shade = (
            1
            + look.unevenness * tone
            + look.grain * (grain[:, 1] + grain[:, 2])
            + 0.02 * np.clip(relief, -3, 6)
        )
        bare = _mix(
            colour * shade[:, None],
            look.vessels,
            look.vessel_strength * _vessels(attributes, density, look.vessel_width),
        )
        covered = smoothstep(0.6 - 0.9 * look.mucus, 1.4 - 0.6 * look.mucus, patches * tone - density)
        return np.clip(_mix(bare, look.mucus_colour, 0.6 * covered), 0.01, 1.0)

    def _domes(self, hits: Hits) -> Vectors:
        """Compute how bubbles bend the normals of the wet surface: towards those of a sphere."""
        bend = np.zeros_like(hits.points)
        bubble = self._bubble_at.take(hits.vertex)
        near = np.flatnonzero(bubble >= 0)
        if len(near):
            sphere = self._bubbles[bubble[near]]
            off = (hits.world[near] - sphere[:, :3]) / sphere[:, 3:]
            bend[near] = 1.2 * (_dot(off, off) < 1)[:, None] * turned(off, hits.turn.T)
        return bend


def _lamplight(
    points: Vectors,
    tissue: Vectors,
    wet: Vectors,
    distance: Scalars,
    light: Light,
    lit: Float32[np.ndarray, "n k"],
    look: Tissue,
) -> tuple[Scalars, Scalars]:
    """Compute the lamps' diffuse light on tissue and highlights of its film, by the inverse-square law."""
    to_lens = -points / distance[:, None]
    diffuse, shine = np.zeros_like(distance), np.zeros_like(distance)
    wrap, power = np.float32(look.softness), np.float32(look.shininess)
    for lamp, share, reaches in zip(light.lamps, light.powers, lit.T, strict=True):
        to_lamp = np.asarray(lamp, np.float32) - points
        squared = _dot(to_lamp, to_lamp)
        to_lamp /= np.sqrt(squared)[:, None]
        arriving = share * reaches * np.clip(-to_lamp[:, 2], 0.05, 1) ** np.float32(light.beam) / squared
        diffuse += arriving * np.clip((_dot(tissue, to_lamp) + wrap) / (1 + wrap), 0, 1)
        shine += arriving * np.clip(_dot(wet, _unit(to_lamp + to_lens)), 0, 1) ** power
    return diffuse, shine


def _bubbles(colon: Colon, tissue: Tissue, random: np.random.Generator) -> Float32[np.ndarray, "b 4"]:
    """Draw centres and radii in mm of bubbles on the wall, in clusters."""
    rows = []
    for _ in range(tissue.bubbles):
        middle = colon.vertices[random.integers(len(colon.vertices))]
        count = int(random.integers(3, 12))
        spread = random.normal(0, 1.5, (count, 3))
        radii = random.uniform(0.25, 1.0, (count, 1)) * tissue.bubble_size
        rows.append(np.concatenate([middle + spread, radii], axis=1))
    return np.concatenate(rows).astype(np.float32) if rows else np.zeros((0, 4), np.float32)


def _nearby(colon: Colon, bubbles: Float32[np.ndarray, "b 4"]) -> np.ndarray:
    """Find the index of a bubble that may reach points around each vertex; -1 if there is none."""
    nearest = np.full(len(colon.vertices), -1, np.int32)
    for index, (*middle, radius) in enumerate(bubbles):
        off = colon.vertices - np.asarray(middle, np.float32)
        nearest[_dot(off, off) < (radius + 1.0) ** 2] = index
    return nearest


def _winding_lines(colon: Colon, cell: float, random: np.random.Generator) -> Float32[np.ndarray, "v 2"]:
    """Estimate signed distances in mm along the wall to the zero lines of two fields, by their slopes."""
    lattice, step = random_lattice(random, 2), np.float32(0.02 * cell)
    points = colon.vertices + 0.25 * cell * value_noise(colon.vertices, 0.5 * cell, random_lattice(random, 3))
    field = value_noise(points, cell, lattice)
    shifts = step * np.eye(3, dtype=np.float32)
    slope = np.stack([value_noise(points + shift, cell, lattice) - field for shift in shifts], axis=-1) / step
    slope -= np.einsum("vci,vi->vc", slope, colon.normals)[..., None] * colon.normals[:, None]
    return field / np.maximum(np.linalg.norm(slope, axis=-1), 0.15 / cell)


def _vessels(attributes: Attributes, density: np.ndarray, half_width: float) -> Scalars:
    """Compute the strength of vessels in [0, 1]; they taper with density, capillaries are half as wide."""
    width = half_width * smoothstep(-0.25, 0.55, density) + 1e-3
    fine = 0.5 * half_width * smoothstep(-0.1, 0.5, density) + 1e-3
    half_widths = np.stack([width, 0.65 * width, fine, 0.8 * fine], axis=1)
    lines = np.clip(1 - np.abs(attributes[:, :4]) / half_widths, 0, 1)
    return (lines * np.array([1.0, 0.85, 0.45, 0.4], np.float32)).max(axis=1)


def turned(vectors: Vectors, turn: Float32[np.ndarray, "3 3"]) -> Vectors:
    """Rotate each vector. This is no matrix product, whose threads would compete in every process."""
    return np.einsum("ij,nj->ni", turn, vectors)


def _mix(colour: np.ndarray, other: Colour, part: Float[np.ndarray, " n"]) -> np.ndarray:
    return colour + part[:, None] * (np.asarray(other, np.float32) - colour)


def _dot(a: Vectors, b: Vectors) -> Scalars:
    return np.einsum("ni,ni->n", a, b)


def _unit(vectors: Vectors) -> Vectors:
    return vectors / np.sqrt(_dot(vectors, vectors))[:, None]
