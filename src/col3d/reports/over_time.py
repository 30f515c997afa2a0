"""Plot depth and flicker of a video over time."""

import csv
from pathlib import Path

import numpy as np

from col3d.reports.figures.figure import blank, save
from col3d.reports.figures.plots import plain
from col3d.reports.figures.style import BLUE, VERMILLION

SHOWN = ("frame", "depth_min", "depth_median", "depth_max", "flicker")


def draw_over_time(table: Path, out: Path) -> bool:
    """Draw least, median and largest depth of each frame above its flicker.

    Args:
        table: predictions.csv of a video.
        out: the PNG file to write.

    Returns:
        Whether there was a frame to draw.
    """
    with table.open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["depth_median"]]
    if not rows:
        return False
    frame, low, middle, high, flicker = (
        np.array([float(row[name] or "nan") for row in rows]) for name in SHOWN
    )
    canvas = blank(9.0, 4.6)
    depth, unsteady = canvas.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    depth.fill_between(frame, low, high, color=BLUE, alpha=0.15, lw=0, label="least to largest")
    depth.plot(frame, middle, color=BLUE, lw=1.5, label="median")
    unit = rows[0]["unit"]
    plain(depth, "", f"depth in {unit}" if unit == "mm" else "relative depth")
    depth.set_ylim(bottom=0)
    depth.legend(frameon=False, loc="lower right", bbox_to_anchor=(1, 0.98), ncols=2)
    unsteady.plot(frame, flicker, color=VERMILLION, lw=1.2)
    plain(unsteady, "frame", "flicker in percent")
    unsteady.set_ylim(bottom=0)
    save(canvas, out)
    return True
