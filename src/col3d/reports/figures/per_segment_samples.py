"""Figure of one frame of each segment with the depth of all methods."""

from pathlib import Path

from col3d.reports.figures.captions import about_maps, sentences
from col3d.reports.figures.choice import one_a_segment
from col3d.reports.figures.depth_sheet import draw_depth
from col3d.reports.figures.figure import Figure
from col3d.reports.figures.figure_data import IN_PICTURES, FigureData

TITLE = "Depth in each segment"
CHOSEN = "Frames are the middle one of each segment's frames, in the order of videos and frames."


def draw(material: FigureData, out: Path) -> Figure:
    """Draw the figure and write it as a PNG file.

    Raises:
        MissingError: truth or predictions are not there.
    """
    truth, group = material.known_truth(), material.main
    methods = group.with_predictions()[:IN_PICTURES]
    path = out / "per_segment_samples.png"
    draw_depth(path, truth, methods, one_a_segment(methods[0].shown))
    caption = sentences(
        "A frame of each segment of the colon with its true depth below, and beside it the depth that each "
        "method predicts with its absolute error below; one scale for all maps of a quantity.",
        CHOSEN,
        about_maps(group, methods),
    )
    return Figure(TITLE, caption, path)
