"""Figure of errors by true depth, and by the angle off the optical axis."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from col3d.io.predictions import StoredPredictions
from col3d.reports.figures.bins import Quartiles, quartiles
from col3d.reports.figures.captions import UNSCALED, about, missing, seeds, sentences
from col3d.reports.figures.figure import Figure, MissingError, blank, save
from col3d.reports.figures.figure_data import IN_PICTURES, FigureData, Method
from col3d.reports.figures.maps import Frame, read_guess, read_truth
from col3d.reports.figures.plots import WIDTH, legend, plain

TITLE = "Errors by depth and by angle"
FRAMES = 100
"""Most frames that are read, evenly spaced, so that a large test part does not take hours."""
SMALLEST_SHARE = 0.001
"""Smallest share of all pixels in a bin that is drawn."""
BINS = {
    "depth": (5.0, "true depth in mm"),
    "off_axis": (5.0, "angle between ray and optical axis in degrees"),
}
ERRORS = {"relative": "|error| / true depth", "absolute": "|error| in mm"}


@dataclass(frozen=True)
class Pixels:
    """Values of all counting pixels, by the names of `BINS` and `ERRORS`."""

    values: Mapping[str, np.ndarray]

    def edges(self, against: str) -> np.ndarray:
        """Edges of bins that cover all pixels."""
        width = BINS[against][0]
        low, high = self.values[against].min(), self.values[against].max()
        return np.arange(np.floor(low / width), np.floor(high / width) + 2) * width

    def curve(self, error: str, against: str) -> tuple[np.ndarray, Quartiles]:
        """Middles of bins, and quartiles of the errors in them."""
        edges = self.edges(against)
        fewest = max(1, int(np.ceil(SMALLEST_SHARE * len(self.values[error]))))
        return (edges[:-1] + edges[1:]) / 2, quartiles(
            self.values[error], self.values[against], edges, fewest
        )


def draw(material: FigureData, out: Path) -> Figure:
    """Draw the figure and write it as a PNG file.

    Raises:
        MissingError: truth or predictions are not there.
    """
    truth, group = material.known_truth(), material.main
    methods = group.with_predictions()[:IN_PICTURES]
    frames = evenly(methods[0])
    pixels = {method.label: read_pixels(truth, method, frames) for method in methods}
    path = out / "error_against.png"
    _draw(path, methods, pixels)
    bins = "bins of 5 mm and 5°" if _has_angles(pixels) else "bins of 5 mm; angles are not kept"
    caption = sentences(
        f"Error of a pixel by its true depth and by how far its ray is off the optical axis: median in "
        f"{bins}, shaded from the lower to the upper quartile. Bins with less than {SMALLEST_SHARE:.1%} of "
        f"the pixels are left out. All counting pixels of {len(frames)} frames, evenly spaced.",
        UNSCALED,
        seeds(methods),
        missing(methods, group.methods),
        about(group),
    )
    return Figure(TITLE, caption, path)


def evenly(method: Method) -> list[Frame]:
    """At most 100 of the frames that were scored, evenly spaced in their order."""
    table = method.shown.frames
    count = len(table["frame"])
    rows = np.unique(np.linspace(0, count - 1, FRAMES).round().astype(int))
    return [(str(table["video"][row]), int(table["frame"][row])) for row in rows]


def read_pixels(truth: StoredPredictions, method: Method, frames: Sequence[Frame]) -> Pixels:
    """Depth, angle and errors of the counting pixels of frames.

    Raises:
        MissingError: a map is not kept, or nothing counts.
    """
    kept = truth.facts.get("off_axis")
    off_axis = None if kept is None else np.array(kept, np.float32)
    parts: dict[str, list[np.ndarray]] = {
        "depth": [],
        "absolute": [],
        **({} if kept is None else {"off_axis": []}),
    }
    for frame in frames:
        known = read_truth(truth, frame)
        parts["depth"].append(known.depth[known.mask])
        parts["absolute"].append(read_guess(method, frame, known).error[known.mask])
        if off_axis is not None:
            parts["off_axis"].append(off_axis[known.mask])
    values = {name: np.concatenate(arrays) for name, arrays in parts.items()}
    if len(values["depth"]) == 0:
        raise MissingError("no pixel of the truth counts")
    return Pixels({**values, "relative": values["absolute"] / values["depth"]})


def _has_angles(pixels: Mapping[str, Pixels]) -> bool:
    return all("off_axis" in measured.values for measured in pixels.values())


def _draw(path: Path, methods: Sequence[Method], pixels: Mapping[str, Pixels]) -> None:
    against = list(BINS) if _has_angles(pixels) else ["depth"]
    canvas = blank(WIDTH, 6.6)
    axes = canvas.subplots(len(ERRORS), len(against), squeeze=False, sharex="col")
    for i, error in enumerate(ERRORS):
        for j, name in enumerate(against):
            for method in methods:
                _curve(axes[i, j], method, *pixels[method.label].curve(error, name))
            axes[i, j].set_ylim(bottom=0)
            plain(axes[i, j], BINS[name][1] if i + 1 == len(ERRORS) else "", ERRORS[error])
    legend(canvas, methods)
    save(canvas, path)


def _curve(axis: Axes, method: Method, middles: np.ndarray, bands: Quartiles) -> None:
    style = method.style
    axis.plot(middles, bands.median, style.dash, color=style.colour, lw=2, marker="o", markersize=3)
    axis.fill_between(middles, bands.lower, bands.upper, color=style.colour, alpha=0.12, lw=0)
