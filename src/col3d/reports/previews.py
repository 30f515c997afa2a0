"""Pictures of depth and normals in 8 bits, and side-by-side pages of them with titles and a colour bar."""

from collections.abc import Sequence
from functools import lru_cache

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8
from PIL import Image, ImageDraw, ImageFont

from col3d.reports.colours import NORMAL_AXES

Pixels = UInt8[np.ndarray, "h w 3"]
GREY, INK, PAPER = 204, (20, 20, 20), (255, 255, 255)
TITLE, GAP, BAR, LABELS = 30, 8, 16, 62
"""Pixels: height of the titles, space between pictures, width of the colour bar and of its labels."""


@lru_cache
def colours(name: str) -> UInt8[np.ndarray, "256 3"]:
    """A colour map of matplotlib as 256 steps of RGB."""
    from matplotlib import colormaps

    steps: np.ndarray = (colormaps[name](np.arange(256))[:, :3] * 255).round().astype(np.uint8)
    return steps


def depth_picture(
    depth: Float[np.ndarray, "h w"],
    low: float,
    high: float,
    mask: Bool[np.ndarray, "h w"] | None = None,
    scale: str = "viridis",
) -> Pixels:
    """Colours of depth or of errors, clipped to the ends of the scale; grey outside the mask."""
    steps = ((depth - low) * (255 / max(high - low, 1e-6))).clip(0, 255).astype(np.uint8)
    return _masked(colours(scale)[steps], mask)


def normals_picture(
    normals: Float[np.ndarray, "h w 3"], mask: Bool[np.ndarray, "h w"] | None = None
) -> Pixels:
    """X to red, -y to green, -z to blue, each from [-1, 1] to [0, 255]; grey outside the mask."""
    shown = (normals * (127.5 * NORMAL_AXES).astype(np.float32) + 127.5).clip(0, 255)
    return _masked(shown.astype(np.uint8), mask)


def with_colour_bar(
    picture: Pixels, low: float, high: float, label: str, scale: str = "viridis"
) -> UInt8[np.ndarray, "down across 3"]:
    """The picture with a colour bar at its right, `label` above the bar's numbers."""
    return SideBySide([""], picture.shape[:2], low, high, label, scale)([picture])


class SideBySide:
    """Pictures of one size beside one another, drawn fast: titles and colour bar are drawn once.

    Args:
        titles: above each picture.
        size_hw: height and width that every picture is shown at.
        low: depth of the lower end of the colour bar.
        high: depth of its upper end.
        label: unit of the colour bar.
        scale: name of its colour map.
    """

    def __init__(
        self,
        titles: Sequence[str],
        size_hw: tuple[int, int],
        low: float,
        high: float,
        label: str,
        scale: str = "viridis",
    ) -> None:
        (self.height, self.width), count = size_hw, len(titles)
        across = count * (self.width + GAP) + BAR + LABELS
        down = TITLE + self.height + GAP
        self.page = Image.new("RGB", (across + across % 2, down + down % 2), PAPER)  # video needs even sides
        draw = ImageDraw.Draw(self.page)
        for place, title in enumerate(titles):
            draw.text((self._left(place), 6), title, INK, _font())
        self._draw_bar(draw, self._left(count), low, high, label, scale)

    def __call__(self, pictures: Sequence[np.ndarray]) -> UInt8[np.ndarray, "down across 3"]:
        """The page with these pictures, each RGB (h, w, 3), resized to fit."""
        page = np.array(self.page)
        for place, picture in enumerate(pictures):
            left = self._left(place)
            page[TITLE : TITLE + self.height, left : left + self.width] = _at(
                picture, self.height, self.width
            )
        return page

    def _left(self, place: int) -> int:
        return place * (self.width + GAP)

    def _draw_bar(
        self, draw: ImageDraw.ImageDraw, left: int, low: float, high: float, label: str, scale: str
    ) -> None:
        steps = np.linspace(255, 0, self.height).round().astype(int)
        bar = np.repeat(colours(scale)[steps][:, None], BAR, axis=1)
        self.page.paste(Image.fromarray(bar), (left, TITLE))
        draw.text((left, 6), label, INK, _font())
        for share in (0.0, 0.25, 0.5, 0.75, 1.0):
            y = TITLE + (1 - share) * (self.height - 1)
            value = low + share * (high - low)
            draw.line([(left + BAR, y), (left + BAR + 4, y)], INK)
            shown = f"{value:.0f}" if high - low >= 8 else f"{value:.2f}"
            anchor = "la" if share == 1 else "ls" if share == 0 else "lm"
            draw.text((left + BAR + 7, y), shown, INK, _font(13), anchor=anchor)


def _font(size: int = 15) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)


def _masked(picture: np.ndarray, mask: np.ndarray | None) -> np.ndarray:
    if mask is not None:
        picture[~mask] = GREY
    return picture


def _at(picture: np.ndarray, height: int, width: int) -> np.ndarray:
    if picture.shape[:2] == (height, width):
        return picture
    smaller = height < picture.shape[0]
    return cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA if smaller else cv2.INTER_LINEAR)
