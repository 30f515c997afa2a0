"""Figure of the depth of each method on the best, an average and the worst frame."""

from pathlib import Path

from col3d.reports.figures.captions import about_maps, sentences
from col3d.reports.figures.choice import best_average_worst
from col3d.reports.figures.depth_sheet import draw_depth
from col3d.reports.figures.figure import Figure
from col3d.reports.figures.figure_data import IN_PICTURES, FigureData, Group, Method

TITLE = "Depth on the best, an average and the worst frame"


def draw(material: FigureData, out: Path) -> Figure:
    """Draw the figure and write it as a PNG file.

    Raises:
        MissingError: truth or predictions are not there.
    """
    truth, group = material.known_truth(), material.main
    methods = group.with_predictions()[:IN_PICTURES]
    best = group.best(methods)
    path = out / "qualitative.png"
    draw_depth(path, truth, methods, best_average_worst(best.shown))
    caption = sentences(
        "Each frame with its true depth below, and beside it the depth that each method predicts with its "
        "absolute error below; one scale for all maps of a quantity.",
        chosen_by(group, best),
        about_maps(group, methods),
    )
    return Figure(TITLE, caption, path)


def chosen_by(group: Group, best: Method) -> str:
    """Sentence on how the best, average and worst frame were chosen."""
    why = ", the method of the lowest mean" if len(group.methods) > 1 else ""
    return f"Frames: lowest, nearest to average and highest Abs Rel of {best.label}{why}."
