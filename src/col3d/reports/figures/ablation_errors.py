"""Figure of the errors of the ablation's rows on the same frames."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from col3d.io.predictions import StoredPredictions
from col3d.reports.figures.captions import about_maps, sentences
from col3d.reports.figures.choice import best_average_worst
from col3d.reports.figures.figure import Figure, MissingError, save
from col3d.reports.figures.figure_data import FigureData, Method
from col3d.reports.figures.maps import Frame, Guess, Maps, Truth, frame_value, read_maps
from col3d.reports.figures.qualitative import chosen_by
from col3d.reports.figures.sheet import Scale, Sheet, errors_up_to, range_of

TITLE = "Errors of the ablation"


def draw(material: FigureData, out: Path) -> Figure:
    """Draw the figure and write it as a PNG file.

    Raises:
        MissingError: truth or predictions are not there, or there is nothing to compare.
    """
    truth, group = material.known_truth(), material.groups.get("ablation")
    if group is None or len(group.methods) < 2:
        raise MissingError("fewer than two rows of the ablation were run")
    methods = group.with_predictions()
    best = group.best(methods)
    path = out / "ablation_errors.png"
    _sheet(path, truth, methods, best_average_worst(best.shown))
    caption = sentences(
        "Each frame, and for each row of the ablation the absolute error of its depth, with the angular "
        "error of its normals below where it predicts them; one scale for all maps of a quantity.",
        chosen_by(group, best),
        about_maps(group, methods),
    )
    return Figure(TITLE, caption, path)


def _sheet(
    path: Path, truth: StoredPredictions, methods: Sequence[Method], chosen: Mapping[Frame, str]
) -> None:
    maps = read_maps(truth, methods, chosen)
    scales = _scales(maps)
    step = 2 if "angle" in scales else 1
    sheet = Sheet([2, 1][:step] * len(chosen), 1 + len(methods), scales)
    for number, (frame, name) in enumerate(chosen.items()):
        row, known = step * number, maps.truths[frame]
        sheet.image(row, 0, known.image, f"{name}, frame {frame[1]}\n{frame[0]}")
        if "depth" in scales:
            sheet.map(row + 1, 0, "depth", known.depth, known.mask, "true depth")
        for column, (method, guess) in enumerate(zip(methods, maps.guesses[frame], strict=True), start=1):
            value = f"depth, Abs Rel {frame_value(method, frame, 'abs_rel'):.3f}"
            title = f"{method.label}\n{value}" if row == 0 else value
            sheet.map(row, column, "error", guess.error, known.mask, title)
            if "angle" in scales:
                _angle(sheet, (row + 1, column), guess, known, frame_value(method, frame, "angle_mean"))
    save(sheet.canvas, path)


def _scales(maps: Maps) -> dict[str, Scale | None]:
    scales: dict[str, Scale | None] = {"error": errors_up_to(maps.errors)}
    if maps.angles:  # normals take a second row, which has room for the truth
        scales["depth"] = range_of(maps.depths)
        scales["angle"] = errors_up_to(maps.angles)
    return scales


def _angle(sheet: Sheet, place: tuple[int, int], guess: Guess, truth: Truth, mean: float) -> None:
    if guess.angle is None:
        sheet.text(*place, "predicts\nno normals")
    else:
        sheet.map(*place, "angle", guess.angle, truth.mask_of_normals, f"normals, mean {mean:.1f}°")
