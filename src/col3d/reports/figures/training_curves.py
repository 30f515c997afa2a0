"""Figure of trainings: metrics on the validation part and losses, by epoch."""

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter

from col3d.errors import naming
from col3d.registry.metric_specs import OURS, MetricSpec
from col3d.reports.figures.captions import about_training, sentences, with_direction
from col3d.reports.figures.figure import Figure, MissingError, blank, save
from col3d.reports.figures.figure_data import FigureData, Method
from col3d.reports.figures.plots import WIDTH, axis_label, from_zero, legend, plain
from col3d.reports.figures.style import Dash
from col3d.reports.options import at
from col3d.reports.runs import Run

TITLE = "Training"
ALWAYS = ("abs_rel", "angle_mean")
"""Metrics of ours that are drawn, beside all those of plugins."""
MOST = 4
"""Most metrics in the figure."""
LOSSES: dict[str, tuple[Dash, str]] = {"train/loss": ("-", "training"), "val/loss": (":", "validation")}
Curve = tuple[np.ndarray, np.ndarray]
"""Epochs, from 1, and values."""


def draw(material: FigureData, out: Path) -> Figure:
    """Draw the figure and write it as a PNG file.

    Raises:
        MissingError: no run has kept its metrics by epoch.
    """
    group = material.main
    methods = [m for m in group.methods if any(curves(run) for run in m.runs)]
    if not methods:
        raise MissingError("no run has a metrics.csv with values by epoch")
    path = out / "training_curves.png"
    panels = _panels(methods)
    draw_methods(path, methods)
    shown = " and ".join(with_direction(spec) for spec in panels)
    caption = sentences(
        f"{shown or 'No metric'} on the validation part by epoch; a line a seed, a ring "
        "where the weights were kept. Losses are on a logarithmic scale; those of different terms cannot be "
        "compared.",
        about_training(group),
    )
    return Figure(TITLE, caption, path)


def curves(run: Run) -> dict[str, Curve]:
    """Curves in a run's `metrics.csv`, by name; empty where the file is absent or is no table.

    Raises:
        OSError: the file exists and cannot be read.
    """
    path = run.folder / "metrics.csv"
    try:
        with naming(path), path.open(newline="", encoding="utf-8") as file:
            rows = [row for row in csv.DictReader(file) if row.get("epoch")]
        names = (*(f"val/{name}" for name in run.specs), *LOSSES)
        return {name: curve for name in names if (curve := _curve(rows, name)) is not None}
    except (FileNotFoundError, ValueError):
        return {}


def _curve(rows: Sequence[dict[str, str]], name: str) -> Curve | None:
    """The last value of each epoch; None where there is none."""
    values = {int(row["epoch"]) + 1: float(row[name]) for row in rows if row.get(name)}
    return (np.array(list(values)), np.array(list(values.values()))) if values else None


def _panels(methods: Sequence[Method]) -> list[MetricSpec]:
    """Specs of the validation metrics to draw: those of `ALWAYS` and of plugins that any run measured."""
    runs = [run for method in methods for run in method.runs]
    specs = {name: spec for run in runs for name, spec in run.specs.items()}
    measured = {name for run in runs for name in curves(run)}
    others = [name for name in specs if name not in OURS]
    return [specs[name] for name in (*ALWAYS, *others) if f"val/{name}" in measured][:MOST]


def draw_methods(path: Path, methods: Sequence[Method]) -> None:
    """Draw the curves of methods, each of which has some, into a file."""
    panels = _panels(methods)
    canvas = blank(WIDTH, 3.9)
    *metrics, losses = canvas.subplots(1, len(panels) + 1, squeeze=False)[0]
    for method in methods:
        for run_curves, run in ((curves(run), run) for run in method.runs):
            for axis, spec in zip(metrics, panels, strict=True):
                if curve := run_curves.get(f"val/{spec.name}"):
                    scaled = curve[0], curve[1] * spec.scale
                    _line(axis, scaled, method, method.style.dash)
                    _ring(axis, scaled, method, run)
            for name, (dash, _) in LOSSES.items():
                if name in run_curves:
                    _line(losses, run_curves[name], method, dash)
    for axis, spec in zip(metrics, panels, strict=True):
        plain(axis, "epoch", axis_label(spec))
        axis.set_title("validation", fontsize=10)
        from_zero([axis])
        axis.xaxis.get_major_locator().set_params(integer=True)
    plain(losses, "epoch", "")
    losses.set_yscale("log")
    losses.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    losses.yaxis.set_major_formatter("{x:g}")
    losses.yaxis.set_minor_formatter(NullFormatter())
    losses.set_title("loss", fontsize=10)
    losses.xaxis.get_major_locator().set_params(integer=True)
    kinds = [
        Line2D([], [], color="0.3", linestyle=dash, label=f"loss, {word}") for dash, word in LOSSES.values()
    ]
    legend(canvas, methods, kinds)
    save(canvas, path)


def _line(axis: Axes, curve: Curve, method: Method, dash: Dash) -> None:
    marker = "o" if len(curve[0]) < 2 else None
    axis.plot(*curve, linestyle=dash, color=method.style.colour, lw=1.5, marker=marker, markersize=4)


def _ring(axis: Axes, curve: Curve, method: Method, run: Run) -> None:
    """Mark the epoch of the best weights with a ring."""
    kept = at(run.summary, "best.epoch")
    here = curve[0] == (-1 if kept is None else int(kept) + 1)
    axis.plot(
        curve[0][here], curve[1][here], "o", color=method.style.colour, markersize=8, markerfacecolor="none"
    )
