"""Figure of abs_rel, and of metrics of plugins, over the frames of each video."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from col3d.registry.metric_specs import OURS, MetricSpec
from col3d.reports.figures.captions import about, repeats, sentences, with_direction
from col3d.reports.figures.figure import Figure, MissingError, blank, save
from col3d.reports.figures.figure_data import FigureData, Method
from col3d.reports.figures.plots import WIDTH, axis_label, from_zero, legend, plain

TITLE = "Metrics by video"
FIRST = "abs_rel"
MOST = 4
"""Most metrics in the figure."""
VIDEOS_A_ROW, POINTS_A_BOX = 6, 150


def draw(material: FigureData, out: Path) -> Figure:
    """Draw the figure and write it as a PNG file.

    Raises:
        MissingError: no frame has abs_rel.
    """
    group = material.main
    methods = [method for method in group.methods if np.isfinite(method.mean(FIRST))]
    if not methods:
        raise MissingError(f"no frame has {FIRST}")
    path = out / "per_video.png"
    shown = _shown(methods)
    _draw(path, methods, shown)
    caption = sentences(
        f"{' and '.join(map(with_direction, shown))} of the frames of each video: boxes from the lower to "
        "the upper quartile with the median across, whiskers to the furthest frame within 1.5 box lengths, "
        f"a point a frame (at most {POINTS_A_BOX} a box, evenly spaced).",
        repeats(methods),
        about(group),
    )
    return Figure(TITLE, caption, path)


def _shown(methods: Sequence[Method]) -> list[MetricSpec]:
    """Specs of the metrics in the figure: abs_rel, and those of plugins that any method has."""
    specs = {name: spec for m in methods for run in m.runs for name, spec in run.specs.items()}
    others = [
        spec
        for name, spec in specs.items()
        if name not in OURS and spec.by_video and any(np.isfinite(m.mean(name)) for m in methods)
    ]
    return [OURS[FIRST], *others][:MOST]


def _draw(path: Path, methods: Sequence[Method], metrics: Sequence[MetricSpec]) -> None:
    frames = methods[0].runs[0].frames
    segments = dict(zip(frames["video"].tolist(), frames["segment"].tolist(), strict=True))
    videos = sorted(segments)
    rows = [videos[i : i + VIDEOS_A_ROW] for i in range(0, len(videos), VIDEOS_A_ROW)]
    canvas = blank(WIDTH, 3.6 * len(rows) * len(metrics) + 0.7)
    axes = list(canvas.subplots(len(rows) * len(metrics), 1, squeeze=False)[:, 0])
    for n, spec in enumerate(metrics):
        metric_axes = axes[n * len(rows) : (n + 1) * len(rows)]
        _draw_metric(metric_axes, methods, spec, rows, segments)
    legend(canvas, methods)
    save(canvas, path)


def _draw_metric(
    axes: Sequence[Axes],
    methods: Sequence[Method],
    spec: MetricSpec,
    rows: Sequence[list[str]],
    segments: Mapping[str, str],
) -> None:
    """The rows of videos of one metric, on one scale."""
    for axis in axes[1:]:
        axis.sharey(axes[0])
    for axis, shown in zip(axes, rows, strict=True):
        for place, video in enumerate(shown):
            for number, method in enumerate(methods):
                _box(
                    axis,
                    place + (number - (len(methods) - 1) / 2) * 0.8 / len(methods),
                    method,
                    video,
                    (spec, len(methods)),
                )
        axis.set_xticks(range(len(shown)), [f"{video}\n{segments[video]}" for video in shown])
        axis.set_xlim(-0.5, len(rows[0]) - 0.5)
        plain(axis, "", axis_label(spec))
    from_zero(axes)


def _box(axis: Axes, place: float, method: Method, video: str, drawn: tuple[MetricSpec, int]) -> None:
    """A box at a place of the x axis, and its frames as points, moved aside by their order."""
    spec, count = drawn
    values = np.concatenate([run.values(spec.name)[run.frames["video"] == video] for run in method.runs])
    values = values[np.isfinite(values)] * spec.scale
    if len(values) == 0:
        return
    width, colour = 0.62 / count, method.style.colour
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
