"""How trainings went: errors on the validation part and losses, by epoch."""

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter

from col3d.checks import naming
from col3d.reports.figures.captions import about_training, sentences
from col3d.reports.figures.figure import Figure, MissingError, blank, save
from col3d.reports.figures.material import Material, Method
from col3d.reports.figures.plots import WIDTH, legend, plain
from col3d.reports.figures.style import Dash
from col3d.reports.options import at
from col3d.reports.runs import Run
from col3d.reports.tables import METRICS

TITLE = "Training"
PANELS = {"val/abs_rel": "Abs Rel", "val/angle_mean": "mean angle in degrees"}
LOSSES: dict[str, tuple[Dash, str]] = {"train/loss": ("-", "training"), "val/loss": (":", "validation")}
Curve = tuple[np.ndarray, np.ndarray]
"""Epochs, from 1, and values."""


def draw(material: Material, out: Path) -> Figure:
    """Draw it.

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
    shown = " and ".join(METRICS[name.removeprefix("val/")].heading for name in panels)
    caption = sentences(
        f"{shown or 'No metric'} on the validation part by epoch, lower is better; a line a seed, a ring "
        "where the weights were kept. Losses are on a logarithmic scale; those of different terms cannot be "
        "compared.",
        about_training(group),
    )
    return Figure(TITLE, caption, path)


def curves(run: Run) -> dict[str, Curve]:
    """Values by epoch of what `metrics.csv` has, by its name; nothing where it is not there or is no table.

    Raises:
        OSError: it is there, and cannot be read.
    """
    path = run.folder / "metrics.csv"
    try:
        with naming(path), path.open(newline="", encoding="utf-8") as file:
            rows = [row for row in csv.DictReader(file) if row.get("epoch")]
        return {name: curve for name in (*PANELS, *LOSSES) if (curve := _curve(rows, name)) is not None}
    except (FileNotFoundError, ValueError):
        return {}


def _curve(rows: Sequence[dict[str, str]], name: str) -> Curve | None:
    """The last value of each epoch."""
    values = {int(row["epoch"]) + 1: float(row[name]) for row in rows if row.get(name)}
    return (np.array(list(values)), np.array(list(values.values()))) if values else None


def _panels(methods: Sequence[Method]) -> list[str]:
    """What any of the runs has measured on the validation part."""
    return [name for name in PANELS if any(name in curves(run) for m in methods for run in m.runs)]


def draw_methods(path: Path, methods: Sequence[Method]) -> None:
    """Draw the curves of methods, each of which has some, into a file."""
    panels = _panels(methods)
    canvas = blank(WIDTH, 3.9)
    *metrics, losses = canvas.subplots(1, len(panels) + 1, squeeze=False)[0]
    for method in methods:
        for found, run in ((curves(run), run) for run in method.runs):
            for axis, name in zip(metrics, panels, strict=True):
                if name in found:
                    _line(axis, found[name], method, method.style.dash)
                    _ring(axis, found[name], method, run)
            for name, (dash, _) in LOSSES.items():
                if name in found:
                    _line(losses, found[name], method, dash)
    for axis, name in zip(metrics, panels, strict=True):
        plain(axis, "epoch", PANELS[name])
        axis.set_title("validation", fontsize=10)
        axis.set_ylim(bottom=0)
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
    """Where the best weights are of."""
    kept = at(run.summary, "best.epoch")
    here = curve[0] == (-1 if kept is None else int(kept) + 1)
    axis.plot(
        curve[0][here], curve[1][here], "o", color=method.style.colour, markersize=8, markerfacecolor="none"
    )
