"""How abs_rel is spread over the frames of each video."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from col3d.reports.figures.captions import about, repeats, sentences
from col3d.reports.figures.figure import Figure, MissingError, blank, save
from col3d.reports.figures.material import Material, Method
from col3d.reports.figures.plots import WIDTH, legend, plain

TITLE = "Abs Rel by video"
VIDEOS_A_ROW, POINTS_A_BOX = 6, 150


def draw(material: Material, out: Path) -> Figure:
    """Draw it.

    Raises:
        MissingError: no frame has abs_rel.
    """
    group = material.main
    methods = [method for method in group.methods if np.isfinite(method.mean("abs_rel"))]
    if not methods:
        raise MissingError("no frame has abs_rel")
    path = out / "per_video.png"
    _draw(path, methods)
    caption = sentences(
        "Abs Rel of the frames of each video (lower is better): boxes from the lower to the upper quartile "
        "with the median across, whiskers to the furthest frame within 1.5 box lengths, a point a frame (at "
        f"most {POINTS_A_BOX} a box, evenly spaced).",
        repeats(methods),
        about(group),
    )
    return Figure(TITLE, caption, path)


def _draw(path: Path, methods: Sequence[Method]) -> None:
    frames = methods[0].runs[0].frames
    segments = dict(zip(frames["video"].tolist(), frames["segment"].tolist(), strict=True))
    videos = sorted(segments)
    rows = [videos[i : i + VIDEOS_A_ROW] for i in range(0, len(videos), VIDEOS_A_ROW)]
    canvas = blank(WIDTH, 3.6 * len(rows) + 0.7)
    axes = canvas.subplots(len(rows), 1, squeeze=False, sharey=True)[:, 0]
    for axis, shown in zip(axes, rows, strict=True):
        for place, video in enumerate(shown):
            for number, method in enumerate(methods):
                _box(
                    axis,
                    place + (number - (len(methods) - 1) / 2) * 0.8 / len(methods),
                    method,
                    video,
                    methods,
                )
        axis.set_xticks(range(len(shown)), [f"{video}\n{segments[video]}" for video in shown])
        axis.set_xlim(-0.5, len(rows[0]) - 0.5)
        plain(axis, "", "Abs Rel")
    axes[0].set_ylim(bottom=0)
    legend(canvas, methods)
    save(canvas, path)


def _box(axis: Axes, place: float, method: Method, video: str, methods: Sequence[Method]) -> None:
    """A box at a place of the x axis, and its frames as points, moved aside by their order."""
    values = np.concatenate([run.values("abs_rel")[run.frames["video"] == video] for run in method.runs])
    values = values[np.isfinite(values)]
    if len(values) == 0:
        return
    width, colour = 0.62 / len(methods), method.style.colour
    axis.boxplot(
        values,
        positions=[place],
        widths=width,
        showfliers=False,
        manage_ticks=False,
        boxprops={"color": colour, "linestyle": method.style.dash},
        whiskerprops={"color": colour},
        capprops={"color": colour},
        medianprops={"color": colour, "linewidth": 2.5},
    )
    points = values[np.unique(np.linspace(0, len(values) - 1, POINTS_A_BOX).round().astype(int))]
    aside = (np.arange(len(points)) * 0.618 % 1 - 0.5) * width * 0.8
    axis.plot(place + aside, points, ".", color=colour, alpha=0.5, markersize=5, markeredgewidth=0)
