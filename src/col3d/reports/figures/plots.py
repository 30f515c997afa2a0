"""Helpers of plots: plain axes, and one legend above them."""

import math
from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.lines import Line2D

from col3d.registry.metric_specs import MetricSpec
from col3d.reports.figures.figure_data import Method

WIDTH, CHARACTERS = 11.0, 125
"""Width of a canvas in inches, and characters of a legend in one line."""


def plain(axis: Axes, x: str, y: str) -> None:
    """Style axes: labels with units, light lines across, no box."""
    axis.set_xlabel(x)
    axis.set_ylabel(y)
    axis.grid(axis="y", color="0.9")
    axis.set_axisbelow(True)
    axis.spines[["top", "right"]].set_visible(False)


def legend(canvas: Canvas, methods: Sequence[Method], more: Sequence[Line2D] = ()) -> None:
    """Draw a legend with the line of each method above the axes."""
    lines = [
        Line2D([], [], color=m.style.colour, linestyle=m.style.dash, label=m.label, lw=2) for m in methods
    ]
    rows = math.ceil(sum(len(str(line.get_label())) + 7 for line in (*lines, *more)) / CHARACTERS)
    columns = math.ceil(len((*lines, *more)) / rows)
    canvas.legend(handles=[*lines, *more], loc="outside upper center", ncols=columns, frameon=False)


def axis_label(spec: MetricSpec) -> str:
    """A metric's heading and unit, with dollars escaped: they begin no formula."""
    return f"{spec.title} {spec.unit}".strip().replace("$", r"\$")


def from_zero(axes: Sequence[Axes]) -> None:
    """Let axes of one scale begin at 0, unless values are below."""
    if min(axis.dataLim.ymin for axis in axes) >= 0:
        axes[0].set_ylim(bottom=0)
