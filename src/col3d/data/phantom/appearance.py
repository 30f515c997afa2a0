"""How the phantom looks: mucosa, vessels and wet highlights under two lamps beside the lens."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32

from col3d.data.phantom.anatomy import Colon
from col3d.data.phantom.noise import random_lattice, smoothstep, value_noise

LAMPS = ((-3.2, 1.2, -0.5), (2.8, 1.6, -0.5))
"""Places of the lamps in camera axes, in mm."""
SCATTER = 0.5
"""Light that arrives from the rest of the wall, over the light of the lamps at the same distance."""
EXPOSED = 0.55
"""What the exposure brings the upper quartile of a frame to, before the tone curve."""
GAMMA = 2.2
SHININESS = 260.0
GRAIN, FILM = 1.7, 0.45
"""Sizes in mm of the tissue's grain and of the ripples of the wet film."""
THICK, THIN = 14.0, 6.0
"""Distances in mm over which vessels and capillaries wind."""

Colour = tuple[float, float, float]
Vectors = Float32[np.ndarray, "n 3"]
Attributes = Float32[np.ndarray, "n 8"]
"""Signed distances in mm to two vessels and two capillaries, patches, tone, density of vessels, relief."""


@dataclass(frozen=True)
class Palette:
    """One of the four textures of a segment; colours as linear reflectances."""

    mucosa: Colour
    patches: Colour
    vessels: Colour
    vessel_strength: float
    patchiness: float
    gloss: float
    roughness: float


PALETTES = {
    "1": Palette((0.52, 0.28, 0.22), (0.48, 0.20, 0.14), (0.34, 0.10, 0.09), 0.50, 0.5, 2.0, 0.10),
    "2": Palette((0.72, 0.28, 0.21), (0.76, 0.44, 0.33), (0.45, 0.06, 0.05), 0.75, 0.7, 3.0, 0.13),
    "3": Palette((0.74, 0.22, 0.16), (0.58, 0.08, 0.06), (0.42, 0.03, 0.03), 0.55, 0.9, 4.5, 0.15),
    "4": Palette((0.72, 0.30, 0.20), (0.68, 0.18, 0.12), (0.42, 0.08, 0.06), 0.85, 0.7, 2.5, 0.12),
}


class Mucosa:
    """The surface of one colon: slow variation kept at its vertices, fine variation found at each point.

    Args:
        colon: the wall.
        palette: its texture.
        random: what makes this surface differ from others of the texture.
    """

    def __init__(self, colon: Colon, palette: Palette, random: np.random.Generator) -> None:
        self.palette = palette
        warp = value_noise(colon.vertices, 7.0, random_lattice(random, 3))
        slow = value_noise(colon.vertices + 3 * warp, 16.0, random_lattice(random, 3))
        quick = value_noise(colon.vertices + 1.5 * warp, 5.0, random_lattice(random, 1))
        vessels = _winding_lines(colon, THICK, random), _winding_lines(colon, THIN, random)
        columns = [*vessels, slow[:, :1] + 0.6 * quick, slow[:, 1:], colon.relief[:, None]]
        self.attributes: Float32[np.ndarray, "v 8"] = np.concatenate(columns, axis=1)
        self._grain, self._film = random_lattice(random, 3), random_lattice(random, 3)

    def albedo(self, attributes: Attributes, grain: Vectors) -> Vectors:
        """Linear reflectance where the wall has these attributes and this grain."""
        look, (patches, tone, density, relief) = self.palette, attributes[:, 4:].T
        patches = smoothstep(0.0, 0.8, patches + 0.15 * grain[:, 0])
        colour = _mix(np.asarray(look.mucosa, np.float32), look.patches, look.patchiness * patches)
        shade = 1 + 0.22 * tone + 0.05 * grain[:, 1] + 0.02 * np.clip(relief, -3, 6)
        return _mix(
            colour * shade[:, None], look.vessels, look.vessel_strength * _vessels(attributes, density)
        )

    def radiance(
        self, points: Vectors, normals: Vectors, world: Vectors, attributes: Attributes, pixel: float
    ) -> Vectors:
        """Linear light that reaches the lens from points seen in camera axes.

        Args:
            points: in camera axes, mm.
            normals: unit, in camera axes, facing the camera.
            world: the same points where the textures live.
            attributes: of the mesh, interpolated.
            pixel: angle between neighbouring pixels in radians.
        """
        grain = value_noise(world, GRAIN, self._grain)
        film = value_noise(world + 0.4 * grain, FILM, self._film)
        distance = np.linalg.norm(points, axis=-1)
        visible = np.clip(FILM / (pixel * distance), 0.25, 1.0)[:, None]  # ripples under a pixel average out
        tissue = _unit(normals + 0.5 * self.palette.roughness * grain)
        wet = _unit(tissue + 1.6 * self.palette.roughness * visible * film)
        diffuse, shine = _lit(points, tissue, wet, distance)
        albedo = self.albedo(attributes, grain)
        indirect = (SCATTER / distance**2)[:, None] * albedo * albedo
        gloss = self.palette.gloss * smoothstep(-1.0, 0.8, attributes[:, 4] + 0.5 * grain[:, 2])
        return albedo * diffuse[:, None] + indirect + (gloss * shine)[:, None]


def develop(radiance: Vectors, off_axis: Float32[np.ndarray, " n"], random: np.random.Generator) -> Vectors:
    """Display values in [0, 1]: vignette, exposure by the upper quartile, tone curve, gamma and noise.

    Args:
        radiance: linear light of the pixels of one frame.
        off_axis: cosine of each pixel's angle to the optical axis.
        random: source of the sensor's noise.
    """
    light = radiance * (0.35 + 0.65 * off_axis)[:, None]
    exposure = np.float32(EXPOSED / max(float(np.quantile(light.mean(axis=-1), 0.75)), 1e-12))
    shown = (1 - np.exp(-exposure * light)) ** np.float32(1 / GAMMA)
    noise = random.standard_normal(shown.shape, dtype=np.float32)
    return np.clip(0.02 + 0.98 * shown + 0.008 * noise, 0, 1)


def _lit(
    points: Vectors, tissue: Vectors, wet: Vectors, distance: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Light of the lamps on tissue, and mirrored by its film: inverse-square, weaker off their axis."""
    to_lens = -points / distance[:, None]
    diffuse, shine = np.zeros_like(distance), np.zeros_like(distance)
    for lamp in LAMPS:
        to_lamp = np.asarray(lamp, np.float32) - points
        squared = _dot(to_lamp, to_lamp)
        to_lamp /= np.sqrt(squared)[:, None]
        light = np.clip(-to_lamp[:, 2], 0.05, 1) / (squared * len(LAMPS))
        diffuse += light * np.clip(_dot(tissue, to_lamp), 0, 1)
        shine += light * np.clip(_dot(wet, _unit(to_lamp + to_lens)), 0, 1) ** np.float32(SHININESS)
    return diffuse, shine


def _winding_lines(colon: Colon, cell: float, random: np.random.Generator) -> Float32[np.ndarray, "v 2"]:
    """Signed distances along the wall to the zero lines of two fields, in mm, as far as a slope tells."""
    lattice, step = random_lattice(random, 2), np.float32(0.02 * cell)
    points = colon.vertices + 0.25 * cell * value_noise(colon.vertices, 0.5 * cell, random_lattice(random, 3))
    field = value_noise(points, cell, lattice)
    shifts = step * np.eye(3, dtype=np.float32)
    slope = np.stack([value_noise(points + shift, cell, lattice) - field for shift in shifts], axis=-1) / step
    slope -= np.einsum("vci,vi->vc", slope, colon.normals)[..., None] * colon.normals[:, None]
    return field / np.maximum(np.linalg.norm(slope, axis=-1), 0.15 / cell)


def _vessels(attributes: Attributes, density: np.ndarray) -> Float32[np.ndarray, " n"]:
    """Strength of vessels in [0, 1]; they taper where their density falls."""
    width = 0.45 * smoothstep(-0.25, 0.55, density) + 1e-3
    fine = 0.22 * smoothstep(-0.1, 0.5, density) + 1e-3
    half_widths = np.stack([width, 0.65 * width, fine, 0.8 * fine], axis=1)
    lines = np.clip(1 - np.abs(attributes[:, :4]) / half_widths, 0, 1)
    return (lines * np.array([1.0, 0.85, 0.45, 0.4], np.float32)).max(axis=1)


def _mix(colour: np.ndarray, other: Colour, part: Float[np.ndarray, " n"]) -> np.ndarray:
    return colour + part[:, None] * (np.asarray(other, np.float32) - colour)


def _dot(a: Vectors, b: Vectors) -> Float32[np.ndarray, " n"]:
    return np.einsum("ni,ni->n", a, b)


def _unit(vectors: Vectors) -> Vectors:
    return vectors / np.sqrt(_dot(vectors, vectors))[:, None]
