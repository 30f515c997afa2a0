"""Figure of the data: a frame of each segment with its truth."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from col3d.reports.colours import GREY
from col3d.reports.figures.captions import NORMALS, about, sentences
from col3d.reports.figures.choice import one_a_segment
from col3d.reports.figures.figure import Figure, save
from col3d.reports.figures.figure_data import FigureData
from col3d.reports.figures.maps import Frame, Truth, read_truth
from col3d.reports.figures.per_segment_samples import CHOSEN
from col3d.reports.figures.sheet import BALL, Scale, Sheet, range_of

TITLE = "The data"
CIRCLES = (20, 40, 60, 80)
"""Degrees off the optical axis that are drawn as lines."""


def draw(material: FigureData, out: Path) -> Figure:
    """Draw the figure and write it as a PNG file.

    Raises:
        MissingError: the truth is not there.
    """
    stored, group = material.known_truth(), material.main
    chosen = one_a_segment(group.methods[0].runs[0])
    truths = {frame: read_truth(stored, frame) for frame in chosen}
    off_axis = np.array(stored.facts["off_axis"]) if "off_axis" in stored.facts else None
    path = out / "data_sheet.png"
    _sheet(path, truths, chosen, off_axis)
    circles = "White lines join pixels whose rays are equally far off the optical axis, every 20°."
    caption = sentences(
        "A frame of each segment of the colon as networks see it, with its true depth and normals; one scale "
        "for all depths. Grey is not known.",
        CHOSEN,
        circles if off_axis is not None else "",
        NORMALS if _have_normals(truths) else "",
        "Last row: white where another surface lies hidden behind." if _have_occlusion(truths) else "",
        about(group),
    )
    return Figure(TITLE, caption, path)


def _sheet(
    path: Path, truths: Mapping[Frame, Truth], chosen: Mapping[Frame, str], off_axis: np.ndarray | None
) -> None:
    scales: dict[str, Scale | None] = {"depth": range_of((t.depth, t.mask) for t in truths.values())}
    if _have_normals(truths):
        scales[BALL] = None
    hidden = [0] if _have_occlusion(truths) else []
    sheet = Sheet([2] + [0] * len(scales) + hidden, len(truths), scales)
    for column, (frame, truth) in enumerate(truths.items()):
        axis = sheet.image(0, column, truth.image, f"{chosen[frame]}, frame {frame[1]}\n{frame[0]}")
        if off_axis is not None:
            _circles(axis, off_axis)
        sheet.map(1, column, "depth", truth.depth, truth.mask)
        if truth.normals is not None and BALL in scales:
            sheet.normals(2, column, truth.normals, truth.mask_of_normals)
        if truth.occlusion is not None:
            grey = np.where(truth.mask, truth.occlusion, GREY)
            sheet.image(1 + len(scales), column, np.repeat(grey[..., None], 3, axis=-1).astype(float))
    save(sheet.canvas, path)


def _have_occlusion(truths: Mapping[Frame, Truth]) -> bool:
    return any(truth.occlusion is not None for truth in truths.values())


def _have_normals(truths: Mapping[Frame, Truth]) -> bool:
    return any(truth.normals is not None for truth in truths.values())


def _circles(axis: Axes, off_axis: np.ndarray) -> None:
    levels = [angle for angle in CIRCLES if off_axis.min() < angle < off_axis.max()]
    if levels:
        lines = axis.contour(off_axis, levels, colors="white", linewidths=0.7, alpha=0.8)
        axis.clabel(lines, fmt="%g°", fontsize=8)
