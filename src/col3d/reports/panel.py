"""Panel of a frame: image, truth, prediction and error of depth, and of normals where they exist."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from col3d.io.atomic import whole_file
from col3d.reports.colours import GREY, colours_of_normals

Maps = Mapping[str, np.ndarray]
"""image (h, w, 3) in [0, 1]; depth, depth_pred (h, w) in mm; mask (h, w); normals, normals_pred (h, w, 3)."""
DEPTH_COLOURS, ERROR_COLOURS = "viridis", "magma"
LARGEST_ANGLE = 45.0


def save_panel(path: Path, maps: Maps, title: str) -> None:
    """Draw and save as PNG: millimetres and degrees on their colour bars, what does not count in grey."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows = 2 if "normals_pred" in maps else 1
    figure = Figure(figsize=(14, 3.0 * rows + 0.2), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(rows, 4, squeeze=False)
    figure.suptitle(title)
    for axis in axes.flat:
        axis.set_axis_off()
    _depth_row(figure, axes[0], maps)
    if rows == 2:
        _normal_row(figure, axes[1], maps)
    with whole_file(path) as file:
        figure.savefig(file, dpi=80, format="png")


def _depth_row(figure, axes, maps: Maps) -> None:  # type: ignore[no-untyped-def]
    mask, truth, prediction = maps["mask"], maps["depth"], maps["depth_pred"]
    low, high = np.quantile(truth[mask], [0.0, 1.0]) if mask.any() else (0.0, 1.0)
    axes[0].imshow(maps["image"])
    axes[0].set_title("image")
    for axis, values, name in ((axes[1], truth, "depth, truth"), (axes[2], prediction, "depth, prediction")):
        shown = axis.imshow(_masked(values, mask), cmap=_colours(DEPTH_COLOURS), vmin=low, vmax=high)
        axis.set_title(name)
    figure.colorbar(shown, ax=list(axes[1:3]), label="mm", shrink=0.85)
    error = np.abs(prediction - truth)
    largest = max(float(np.quantile(error[mask], 0.98)), 1e-3) if mask.any() else 1.0
    shown = axes[3].imshow(_masked(error, mask), cmap=_colours(ERROR_COLOURS), vmin=0, vmax=largest)
    axes[3].set_title("absolute error")
    figure.colorbar(shown, ax=axes[3], label="mm", extend="max", shrink=0.85)


def _normal_row(figure, axes, maps: Maps) -> None:  # type: ignore[no-untyped-def]
    mask = maps["mask"]
    axes[1].set_title("normals, prediction" if "normals" not in maps else "normals, truth")
    if "normals" in maps:
        axes[1].imshow(colours_of_normals(maps["normals"], mask))
        shown = axes[3].imshow(
            _masked(maps["angle"], mask), cmap=_colours(ERROR_COLOURS), vmin=0, vmax=LARGEST_ANGLE
        )
        axes[3].set_title("angular error")
        figure.colorbar(shown, ax=axes[3], label="degrees", extend="max", shrink=0.85)
    prediction = axes[2] if "normals" in maps else axes[1]
    prediction.imshow(colours_of_normals(maps["normals_pred"], mask))
    axes[2].set_title("normals, prediction" if "normals" in maps else "")
    axes[0].text(
        0.5,
        0.5,
        "colours of normals:\nred x right, green y up,\nblue towards the camera",
        ha="center",
        va="center",
        transform=axes[0].transAxes,
    )


def _colours(name: str):  # type: ignore[no-untyped-def]
    from matplotlib import colormaps

    return colormaps[name].with_extremes(bad=str(GREY))


def _masked(values: np.ndarray, mask: np.ndarray) -> np.ndarray:
    return np.ma.masked_where(~mask, values)
