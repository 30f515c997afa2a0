"""A sheet of maps: cells at the true aspect of frames, and one colour bar for each quantity."""

import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize

from col3d.reports.colours import colours_of_normals
from col3d.reports.figures.figure import blank
from col3d.reports.figures.style import FRAME_ASPECT, QUANTITIES, ball

WIDTH, WIDEST_CELL, BARS = 11.5, 2.7, 0.85
"""Inches: the widest sheet and cell, and the height of the strip of colour bars."""
GAP, LINE, LETTER = 0.08, 0.165, 0.068
"""Inches: between cells, the height of a line of a title, and the width of a letter."""
BALL = "normals"
"""Key in `scales` that adds the colour key of normals, a ball."""
LARGEST_SHARE = 0.98


@dataclass(frozen=True)
class Scale:
    """Values at the ends of a colour bar."""

    low: float
    high: float


def range_of(maps: Iterable[tuple[np.ndarray, np.ndarray]]) -> Scale:
    """Scale from the least counting value of all (values, mask) maps to the value that 98 % stay below."""
    values = _counting(maps)
    low, high = float(values.min()), float(np.quantile(values, LARGEST_SHARE))
    return Scale(low, max(high, low + 1e-3))


def errors_up_to(maps: Iterable[tuple[np.ndarray, np.ndarray]]) -> Scale:
    """Scale from 0 to the value that 98 % of the counting values stay below."""
    return Scale(0.0, max(float(np.quantile(_counting(maps), LARGEST_SHARE)), 1e-3))


def _counting(maps: Iterable[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    values = np.concatenate([values[mask] for values, mask in maps])
    values = values[np.isfinite(values)]
    return values if len(values) else np.zeros(1)


class Sheet:
    """Rows and columns of cells above a strip of colour bars, laid out in inches.

    Args:
        titles: for each row, the number of lines of titles above its cells.
        columns: number of columns of cells.
        scales: quantity -> its one scale; `BALL` with None for the key of normals.
    """

    def __init__(self, titles: Sequence[int], columns: int, scales: Mapping[str, Scale | None]) -> None:
        self.scales = scales
        self.width = min(WIDTH, WIDEST_CELL * columns)
        self.cell_size = (self.width / columns - GAP, (self.width / columns - GAP) * FRAME_ASPECT)
        above = np.cumsum([GAP + LINE * lines for lines in titles])
        self.tops = above + self.cell_size[1] * np.arange(len(titles))
        self.height = float(self.tops[-1]) + self.cell_size[1] + BARS
        self.canvas = blank(self.width, self.height, layout=None)
        self._add_bars()

    def _place(self, left: float, top: float, width: float, height: float) -> Axes:
        """Axes at a place in inches from the upper left corner."""
        bottom = self.height - top - height
        return self.canvas.add_axes(
            (left / self.width, bottom / self.height, width / self.width, height / self.height)
        )

    def cell(self, row: int, column: int, title: str = "") -> Axes:
        """Add an empty cell; long titles are wrapped."""
        width, height = self.cell_size
        axis = self._place(GAP / 2 + column * (width + GAP), float(self.tops[row]), width, height)
        axis.set_axis_off()
        lines = [
            textwrap.wrap(line, int(width / LETTER), break_on_hyphens=False) for line in title.split("\n")
        ]
        axis.set_title("\n".join(part for parts in lines for part in parts), fontsize=9.5, pad=3)
        return axis

    def text(self, row: int, column: int, words: str) -> None:
        """Write text in the middle of a cell."""
        axis = self.cell(row, column)
        axis.text(0.5, 0.5, words, ha="center", va="center", fontsize=9.5, transform=axis.transAxes)

    def image(self, row: int, column: int, colours: np.ndarray, title: str = "") -> Axes:
        """Show a picture (h, w, 3), stretched to the frames' true aspect."""
        axis = self.cell(row, column, title)
        axis.imshow(colours, aspect=_aspect(colours))
        return axis

    def normals(self, row: int, column: int, normals: np.ndarray, mask: np.ndarray, title: str = "") -> None:
        """Show unit vectors (h, w, 3) in colours."""
        axis = self.cell(row, column, title)
        colours = colours_of_normals(normals, mask)
        axis.imshow(colours, aspect=_aspect(colours), interpolation="nearest")

    def map(
        self, row: int, column: int, quantity: str, values: np.ndarray, mask: np.ndarray, title: str = ""
    ) -> None:
        """Show values (h, w) on the scale of their quantity."""
        scale = self.scales[quantity]
        assert scale is not None
        shown = np.ma.masked_where(~mask | ~np.isfinite(values), values)
        axis = self.cell(row, column, title)
        axis.imshow(
            shown,
            cmap=QUANTITIES[quantity].colormap,
            vmin=scale.low,
            vmax=scale.high,
            aspect=_aspect(values),
            interpolation="nearest",
        )

    def _add_bars(self) -> None:
        """A colour bar for each quantity, and the ball, side by side below all cells."""
        share, top = self.width / len(self.scales), self.height - BARS + 0.15
        for number, (name, scale) in enumerate(self.scales.items()):
            if scale is None:
                self._add_ball(number * share + 0.3, top)
                continue
            quantity = QUANTITIES[name]
            self.canvas.colorbar(
                ScalarMappable(Normalize(scale.low, scale.high), quantity.colormap),
                cax=self._place(number * share + 0.2, top, share - 0.4, 0.15),
                orientation="horizontal",
                label=quantity.label,
                extend=quantity.extend,
            )

    def _add_ball(self, left: float, top: float) -> None:
        axis = self._place(left, top - 0.08, BARS - 0.15, BARS - 0.15)
        axis.imshow(ball())
        axis.set_axis_off()
        axis.text(1.1, 0.5, "normals of a ball\nas the camera sees it", transform=axis.transAxes, va="center")


def _aspect(values: np.ndarray) -> float:
    """Height by width of one pixel at which the whole picture has the aspect of frames."""
    height, width = values.shape[:2]
    return FRAME_ASPECT * width / height
