"""Appearance of a video: parameters of tissue, lamps and sensor, and their randomisation."""

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace

import numpy as np

Colour = tuple[float, float, float]
Place = tuple[float, float, float]


@dataclass(frozen=True)
class Tissue:
    """Appearance of the wall; colours are linear reflectances, lengths are in mm."""

    mucosa: Colour
    patches: Colour
    vessels: Colour
    vessel_strength: float
    patchiness: float
    gloss: float
    roughness: float
    shininess: float = 260.0
    softness: float = 0.15
    """Extent of light under the surface around edges: added to the cosine, and as blur in mm."""
    grain: float = 0.05
    """Relative change of reflectance by the tissue's grain."""
    grain_size: float = 1.7
    film_size: float = 0.45
    """Size of the ripples of the wet film."""
    patch_size: float = 16.0
    """Size of the slowest variation of colour and brightness."""
    unevenness: float = 0.22
    """Relative variation of brightness at that size."""
    vessel_spacing: float = 14.0
    """Size of the pattern of vessels."""
    vessel_width: float = 0.45
    """Half the width of the widest vessels; that of capillaries is half as large."""
    mucus: float = 0.15
    """Extent of a pale film; at 0 it lies only at extremes of the slowest variation."""
    mucus_colour: Colour = (0.75, 0.66, 0.42)
    bubbles: int = 4
    """Number of clusters of bubbles."""
    bubble_size: float = 1.4
    """Radius of the largest bubbles."""


@dataclass(frozen=True)
class Light:
    """The light guides beside the lens, and the light that the wall scatters."""

    lamps: tuple[Place, ...] = ((-3.2, 1.2, -0.5), (2.8, 1.6, -0.5))
    """Positions in camera axes, in mm."""
    powers: tuple[float, ...] = (0.5, 0.5)
    beam: float = 1.0
    """Exponent of the cosine by which a lamp weakens off its axis."""
    scatter: float = 0.5
    """Light from the rest of the wall relative to that of the lamps, at 20 mm."""
    scatter_fall: float = 2.0
    """Exponent of the distance by which scattered light falls."""
    shadow: float = 0.8
    """Share of a lamp's light that is lost where a fold hides it."""


@dataclass(frozen=True)
class Sensor:
    """Parameters of the camera's sensor and image processing."""

    exposure: float = 0.55
    """Level to which the metered quantile is scaled, before the tone curve."""
    metered: float = 0.75
    """Quantile of a frame's brightness that is metered."""
    gamma: float = 2.2
    shoulder: float = 1.0
    """Tone curve: 0 clips highlights, 1 compresses them."""
    white: Colour = (1.0, 1.0, 1.0)
    black: float = 0.02
    vignette: float = 0.65
    blur: float = 0.0
    """Standard deviation in pixels at an eighth of C3VD's resolution."""
    sharpening: float = 0.0
    noise: float = 0.008
    jpeg: int = 97
    icon: tuple[float, float] = (0.987, 0.967)
    """Centre of the mark in the lower right corner, relative to the width and height of a frame."""
    icon_level: int = 235
    surround: int = 5
    """Highest grey level outside the octagon."""


@dataclass(frozen=True)
class Look:
    """The complete appearance of a video."""

    tissue: Tissue
    light: Light = Light()
    sensor: Sensor = Sensor()

    def varied(self, parts: Collection[str], random: Callable[[str], np.random.Generator]) -> "Look":
        """Randomise parts of the look, in ranges around C3VD's frames that are wide enough to include them.

        Args:
            parts: names of parts to draw: `tissue`, `light` and `sensor`.
            random: function that gives each part its own source, so that none depends on the others.
        """
        return Look(
            _varied_tissue(self.tissue, random("tissue")) if "tissue" in parts else self.tissue,
            _varied_light(random("light")) if "light" in parts else self.light,
            _varied_sensor(random("sensor")) if "sensor" in parts else self.sensor,
        )


LOOKS = {
    "1": Look(Tissue((0.52, 0.28, 0.22), (0.48, 0.20, 0.14), (0.34, 0.10, 0.09), 0.50, 0.5, 2.0, 0.10)),
    "2": Look(Tissue((0.72, 0.28, 0.21), (0.76, 0.44, 0.33), (0.45, 0.06, 0.05), 0.75, 0.7, 3.0, 0.13)),
    "3": Look(Tissue((0.74, 0.22, 0.16), (0.58, 0.08, 0.06), (0.42, 0.03, 0.03), 0.55, 0.9, 4.5, 0.15)),
    "4": Look(Tissue((0.72, 0.30, 0.20), (0.68, 0.18, 0.12), (0.42, 0.08, 0.06), 0.85, 0.7, 2.5, 0.12)),
}
"""Looks of the four textures of a segment."""


def _varied_tissue(tissue: Tissue, random: np.random.Generator) -> Tissue:
    mucosa = _varied_colour(tissue.mucosa, random)
    return replace(
        tissue,
        mucosa=mucosa,
        patches=_scaled(_varied_colour(tissue.patches, random), random.uniform(0.6, 1.3)),
        vessels=_scaled(mucosa, random.uniform(0.3, 0.9), (1.0, 0.7, 0.7)),
        vessel_strength=random.uniform(0.0, 0.9),
        patchiness=random.uniform(0.0, 0.9),
        gloss=float(np.exp(random.uniform(-1.5, 2.0))),
        roughness=random.uniform(0.05, 0.3),
        shininess=float(np.exp(random.uniform(4.5, 6.5))),
        softness=random.uniform(0.0, 0.4),
        grain=float(np.exp(random.uniform(-3.5, -1.5))),
        mucus=random.uniform(0.0, 0.25),
        bubbles=int(random.integers(0, 10)),
        grain_size=tissue.grain_size * float(np.exp(random.uniform(-0.9, 0.9))),
        film_size=tissue.film_size * float(np.exp(random.uniform(-0.7, 1.1))),
        patch_size=tissue.patch_size * float(np.exp(random.uniform(-0.8, 0.6))),
        unevenness=random.uniform(0.0, 0.3),
        vessel_spacing=tissue.vessel_spacing * float(np.exp(random.uniform(-0.7, 0.5))),
        vessel_width=tissue.vessel_width * float(np.exp(random.uniform(-0.7, 0.4))),
        mucus_colour=_varied_colour(tissue.mucus_colour, random),
        bubble_size=random.uniform(0.7, 2.0),
    )


def _varied_light(random: np.random.Generator) -> Light:
    sides = random.uniform(1.8, 3.9, 2) * (-1, 1)
    lamps = tuple((float(x), random.uniform(-1.6, 1.6), random.uniform(-1.5, 0.0)) for x in sides)
    share = random.uniform(0.3, 0.7)
    return Light(
        lamps=lamps,
        powers=(share, 1 - share),
        beam=random.uniform(0.2, 1.6),
        scatter=float(np.exp(random.uniform(-2.0, 0.8))),
        scatter_fall=random.uniform(1.0, 2.2),
        shadow=random.uniform(0.3, 1.0),
    )


def _varied_sensor(random: np.random.Generator) -> Sensor:
    return Sensor(
        exposure=float(np.exp(random.uniform(-3.4, 0.2))),
        metered=random.uniform(0.5, 0.9),
        gamma=random.uniform(1.7, 3.4),
        shoulder=random.uniform(0.0, 1.0),
        white=tuple(np.exp(random.uniform(-0.08, 0.08, 3)).tolist()),
        black=random.uniform(0.0, 0.06),
        vignette=random.uniform(0.2, 0.9),
        blur=random.uniform(0.0, 0.35),
        sharpening=random.uniform(0.0, 1.2) * float(random.random() < 0.7),
        noise=float(np.exp(random.uniform(-6.5, -4.0))),
        jpeg=int(random.integers(80, 99)),
        icon=(random.uniform(0.975, 0.989), random.uniform(0.955, 0.978)),
        icon_level=int(random.integers(150, 256)),
        surround=int(random.integers(1, 12)),
    )


def _varied_colour(colour: Colour, random: np.random.Generator) -> Colour:
    """Vary the brightness and saturation of a colour, and slightly each channel."""
    linear = np.asarray(colour) * np.exp(random.uniform(-0.12, 0.12, 3))
    grey = linear.mean()
    return _colour((grey + (linear - grey) * random.uniform(0.5, 1.5)) * random.uniform(0.7, 1.25))


def _scaled(colour: Colour, factor: float, tint: Colour = (1.0, 1.0, 1.0)) -> Colour:
    return _colour(np.asarray(colour) * factor * np.asarray(tint))


def _colour(linear: np.ndarray) -> Colour:
    red, green, blue = np.clip(linear, 0.02, 0.95).tolist()
    return red, green, blue
