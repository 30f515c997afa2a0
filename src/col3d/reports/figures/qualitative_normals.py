"""Figure of predicted normals, on the best, average and worst frame of depth."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from col3d.io.predictions import StoredPredictions
from col3d.reports.figures.captions import NORMALS, about_maps, sentences
from col3d.reports.figures.choice import best_average_worst
from col3d.reports.figures.figure import Figure, MissingError, save
from col3d.reports.figures.figure_data import IN_PICTURES, FigureData, Method
from col3d.reports.figures.maps import Frame, Guess, Truth, frame_value, read_guess, read_maps, read_truth
from col3d.reports.figures.qualitative import chosen_by
from col3d.reports.figures.sheet import BALL, Sheet, errors_up_to

TITLE = "Normals on the same frames"
MOST = 3
"""Most methods in the figure, each with two columns."""


def draw(material: FigureData, out: Path) -> Figure:
    """Draw the figure and write it as a PNG file.

    Raises:
        MissingError: truth or predictions are not there, or no method predicts normals.
    """
    truth, group = material.known_truth(), material.main
    drawable = group.with_predictions()
    best = group.best(drawable[:IN_PICTURES])
    chosen = best_average_worst(best.shown)
    methods = with_normals(drawable, truth, next(iter(chosen)))[:MOST]
    path = out / "qualitative_normals.png"
    _sheet(path, truth, methods, chosen)
    caption = sentences(
        "Image, true normals, and for each method that predicts normals these with their angular error; one "
        "scale for all errors.",
        NORMALS,
        chosen_by(group, best),
        about_maps(group, methods),
    )
    return Figure(TITLE, caption, path)


def with_normals(methods: Sequence[Method], truth: StoredPredictions, frame: Frame) -> tuple[Method, ...]:
    """The methods that predict normals, judged by one frame.

    Raises:
        MissingError: none does, or true normals are not kept.
    """
    known = read_truth(truth, frame)
    if known.normals is None:
        raise MissingError("the truth has no normals")
    predicting = tuple(method for method in methods if read_guess(method, frame, known).normals is not None)
    if not predicting:
        raise MissingError("no method predicts normals")
    return predicting


def _sheet(
    path: Path, truth: StoredPredictions, methods: Sequence[Method], chosen: Mapping[Frame, str]
) -> None:
    maps = read_maps(truth, methods, chosen)
    sheet = Sheet([2] * len(chosen), 2 + 2 * len(methods), {BALL: None, "angle": errors_up_to(maps.angles)})
    for row, (frame, name) in enumerate(chosen.items()):
        _frame(sheet, row, maps.truths[frame], f"{name}, frame {frame[1]}\n{frame[0]}")
        for number, (method, guess) in enumerate(zip(methods, maps.guesses[frame], strict=True)):
            title = method.label if row == 0 else ""
            value = frame_value(method, frame, "angle_mean")
            titles = (title, f"error, mean {value:.1f}°")
            _pair(sheet, (row, 2 + 2 * number), guess, maps.truths[frame], titles)
    save(sheet.canvas, path)


def _frame(sheet: Sheet, row: int, truth: Truth, words: str) -> None:
    assert truth.normals is not None
    sheet.image(row, 0, truth.image, words)
    sheet.normals(row, 1, truth.normals, truth.mask_of_normals, "true normals" if row == 0 else "")


def _pair(sheet: Sheet, place: tuple[int, int], guess: Guess, truth: Truth, titles: tuple[str, str]) -> None:
    row, column = place
    if guess.normals is not None and guess.angle is not None:
        sheet.normals(row, column, guess.normals, truth.mask, titles[0])
        sheet.map(row, column + 1, "angle", guess.angle, truth.mask_of_normals, titles[1])
