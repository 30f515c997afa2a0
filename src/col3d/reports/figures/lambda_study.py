"""Figure of Col3D-MTL's loss weights and their results, a line for each triple.

The three weights need not add to 1 (the paper has 0.4, 0.2, 0.2), so that a triangle would misplace them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import to_hex

from col3d.registry.metric_specs import OURS
from col3d.reports.figures.captions import about, missing, repeats, sentences
from col3d.reports.figures.figure import Figure, MissingError, blank, save
from col3d.reports.figures.figure_data import FigureData, Group
from col3d.reports.options import loss_of

TITLE = "Weights of the loss"
WEIGHTS = ("depth", "normals", "consistency")
NAMES = tuple(f"weight of\n{name}" for name in WEIGHTS)
RESULTS = {name: f"{OURS[name].title}\n(better below)" for name in ("abs_rel", "angle_mean")}
COLUMNS = (4.14, 5.05, 5.55)
"""X positions of the texts beside each line."""


@dataclass(frozen=True)
class Line:
    """A triple of weights, abs_rel and the mean angle in degrees."""

    label: str
    weights: tuple[float, ...]
    results: tuple[float, ...]


def draw(material: FigureData, out: Path) -> Figure:
    """Draw the figure and write it as a PNG file.

    Raises:
        MissingError: there are fewer than two triples with both metrics.
    """
    group = material.groups.get("lambda")
    lines = [] if group is None else lines_of(group)
    if group is None or len(lines) < 2:
        raise MissingError("fewer than two triples of weights were run")
    path = out / "lambda_study.png"
    _draw(path, lines)
    caption = sentences(
        "Each line is Col3D-MTL trained with one triple of weights: on the left the weights of the three "
        "terms of its loss, on one scale; on the right its means over frames, from the best (below) to the "
        "worst. Dark lines have the lower Abs Rel; the thick one has the lowest. Lines that would cover each "
        "other are moved apart a little.",
        missing([m for m in group.methods if m.label in {line.label for line in lines}], group.methods),
        repeats(group.methods),
        about(group),
    )
    return Figure(TITLE, caption, path)


def lines_of(group: Group) -> list[Line]:
    """The triples that have both metrics, by abs_rel."""
    lines = []
    for method in group.methods:
        results = tuple(method.mean(metric) for metric in RESULTS)
        if np.isfinite(results).all():
            lines.append(Line(method.label, loss_of(method.runs[0].options)[-1], results))
    return sorted(lines, key=lambda line: line.results)


def _draw(path: Path, lines: Sequence[Line]) -> None:
    canvas = blank(10.0, 4.8)
    axis = canvas.subplots()
    lows, highs = (pick([line.results for line in lines], axis=0) for pick in (np.min, np.max))
    top = max(weight for line in lines for weight in line.weights)
    shades = [to_hex(colour) for colour in colormaps["viridis"](np.linspace(0, 0.85, len(lines)))]
    ends = _apart([_height(line.results[-1], lows[-1], highs[-1]) for line in lines])
    for rank, (line, colour, end) in enumerate(zip(lines, shades, ends, strict=True)):
        aside = (rank - (len(lines) - 1) / 2) * 0.008
        heights = [weight / top + aside for weight in line.weights]
        heights += [_height(v, low, high) for v, low, high in zip(line.results, lows, highs, strict=True)]
        axis.plot(
            heights, color=colour, lw=4 if rank == 0 else 1.8, marker="o", markersize=5, zorder=9 - rank
        )
        axis.plot([4, 4.12], [heights[-1], end], color=colour, lw=0.8)
        words = (line.label, f"{line.results[0]:.3f}", f"{line.results[1]:.1f}°")
        _words(axis, end, words, "bold" if rank == 0 else "normal")
    _words(axis, max(*ends, 1.0) + 0.1, ("weights", *(OURS[name].title for name in RESULTS)), "normal")
    _scales(axis, top)
    save(canvas, path)


def _height(value: float, low: float, high: float) -> float:
    """Height of a value between the ends of an axis, 0 to 1; in the middle where the ends are equal."""
    return float((value - low) / (high - low)) if high > low else 0.5


def _apart(heights: Sequence[float], distance: float = 0.075) -> list[float]:
    """Move labels apart so that none covers another, in the same order and close to their heights."""
    order = np.argsort(heights, kind="stable")
    places = np.array(heights, float)[order]
    for _ in range(200):
        gaps = np.diff(places)
        short = np.clip(distance - gaps, 0, None) / 2
        places[:-1] -= short
        places[1:] += short
    result = np.empty_like(places)
    result[order] = places
    return [float(place) for place in result]


def _words(axis: Axes, height: float, words: Sequence[str], weight: str) -> None:
    for x, word in zip(COLUMNS, words, strict=True):
        axis.text(x, height, word, va="center", fontsize=9, fontweight=weight)


def _scales(axis: Axes, top: float) -> None:
    """An upright line for each column, with the one scale of the weights."""
    for column in range(5):
        axis.axvline(column, color="0.8", lw=1, zorder=0)
    for tick in np.arange(0.0, top + 0.05, 0.2):
        axis.plot([0, 2], [tick / top] * 2, color="0.9", lw=1, zorder=0)
        axis.text(-0.06, tick / top, f"{tick:g}", ha="right", va="center", fontsize=8, color="0.35")
    axis.set_xticks(range(5), [*NAMES, *RESULTS.values()])
    axis.tick_params(length=0)
    axis.set_yticks([])
    axis.set_xlim(-0.25, 6.1)
    axis.spines[:].set_visible(False)
