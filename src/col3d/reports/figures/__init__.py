"""Figures of a report, drawn from the tables of runs, their stored predictions and the truth.

Import this package only where figures are drawn: it needs matplotlib.
"""

from collections.abc import Callable
from pathlib import Path

from col3d.reports.figures import (
    ablation_errors,
    data_sheet,
    error_against,
    lambda_study,
    per_segment_samples,
    per_video,
    qualitative,
    qualitative_normals,
    training_curves,
)
from col3d.reports.figures.figure import Drawn, Figure, MissingError
from col3d.reports.figures.figure_data import FigureData, figure_data_of
from col3d.reports.runs import Found

__all__ = ["DRAW", "Drawn", "Figure", "draw", "draw_all"]

DRAW: dict[str, tuple[str, Callable[[FigureData, Path], Figure]]] = {
    module.__name__.rpartition(".")[2]: (module.TITLE, module.draw)
    for module in (
        data_sheet,
        qualitative,
        qualitative_normals,
        per_segment_samples,
        per_video,
        error_against,
        ablation_errors,
        lambda_study,
        training_curves,
    )
}
"""Name of a figure and of its file -> its title, and what draws it; in the order of a report."""


def draw_all(collected: Found, out: Path, truth: Path | None) -> list[Figure]:
    """The figures that runs allow; `draw` also says why others are left out."""
    return list(draw(collected, out, truth).figures)


def draw(collected: Found, out: Path, truth: Path | None) -> Drawn:
    """Draw every figure that runs allow.

    Args:
        collected: the runs.
        out: folder of the PNG files; it is made if needed, and existing figures are replaced.
        truth: folder that `col3d.evaluation.stored_truth.keep_truth` wrote, where there is one.

    Returns:
        The figures in the order of a report, and for each that is left out a line that says why.
    """
    if not collected.runs:
        return Drawn((), ("figures: there is no run",))
    material = figure_data_of(collected, truth)
    out.mkdir(parents=True, exist_ok=True)
    figures, left_out = [], []
    for title, draw_one in DRAW.values():
        try:
            figures.append(draw_one(material, out))
        except MissingError as error:
            left_out.append(f"figure {title!r}: {error}")
    return Drawn(tuple(figures), tuple(left_out))
