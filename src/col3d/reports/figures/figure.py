"""Drawn figures, errors for those that cannot be drawn, and saving as PNG."""

import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Canvas
from PIL import Image

from col3d.io.atomic import write_whole

LARGEST_FILE = 400_000
RESOLUTIONS = (100, 90, 80)
"""Pixels an inch, tried in turn; below the last, words could not be read."""
STEPS = (1, 5)
"""Steps that colours are rounded to, tried in turn: divisors of 255, so that white stays white."""


@dataclass(frozen=True)
class Figure:
    """A picture on disk.

    Attributes:
        caption: can be read alone: what is shown, of which data, and how frames were chosen.
        path: PNG file.
    """

    title: str
    caption: str
    path: Path


@dataclass(frozen=True)
class Drawn:
    """Drawn figures, and a line for each one that is left out."""

    figures: tuple[Figure, ...]
    left_out: tuple[str, ...]


class MissingError(Exception):
    """Reason why a figure cannot be drawn, as a clause without a full stop."""


def blank(width: float, height: float, layout: Literal["constrained"] | None = "constrained") -> Canvas:
    """A canvas of a size in inches, drawn without a display."""
    canvas = Canvas(figsize=(width, height), layout=layout)
    FigureCanvasAgg(canvas)
    return canvas


def save(canvas: Canvas, path: Path) -> None:
    """Save as PNG in one step; above 400 kB colours are made coarser, then pixels fewer, within limits."""
    for content in _attempts(canvas):
        if len(content) <= LARGEST_FILE:
            break
    write_whole(path, content)


def _attempts(canvas: Canvas) -> Iterator[bytes]:
    """PNG files, each smaller than the one before."""
    for dpi in RESOLUTIONS:
        pixels = _pixels(canvas, dpi)
        for step in STEPS:
            yield _png(pixels, step)


def _pixels(canvas: Canvas, dpi: int) -> np.ndarray:
    content = io.BytesIO()
    canvas.savefig(content, dpi=dpi, format="png")
    return np.asarray(Image.open(content, formats=["PNG"]).convert("RGB"))


def _png(pixels: np.ndarray, step: int) -> bytes:
    """PNG with each channel rounded to a multiple of the step, which halves the size of noisy maps."""
    content = io.BytesIO()
    rounded = (np.round(pixels / step) * step).clip(0, 255).astype(np.uint8)
    Image.fromarray(rounded).save(content, format="png", optimize=True)
    return content.getvalue()
