"""Sheet of frames by methods: predicted depth, and its errors below."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from col3d.io.predictions import StoredPredictions
from col3d.reports.figures.figure import save
from col3d.reports.figures.figure_data import Method
from col3d.reports.figures.maps import Frame, Guess, Truth, frame_value, read_maps
from col3d.reports.figures.sheet import Sheet, errors_up_to, range_of


def draw_depth(
    path: Path, truth: StoredPredictions, methods: Sequence[Method], chosen: Mapping[Frame, str]
) -> None:
    """Draw two rows a frame: the image and predictions; below, true depth and the errors.

    Args:
        path: PNG file to write.
        truth: stored truth of the frames.
        methods: one for each column.
        chosen: frame -> why it was chosen, for its title.

    Raises:
        MissingError: a map is not kept.
    """
    maps = read_maps(truth, methods, chosen)
    scales = {"depth": range_of(maps.depths), "error": errors_up_to(maps.errors)}
    sheet = Sheet([2, 1] * len(chosen), 1 + len(methods), scales)
    for number, (frame, name) in enumerate(chosen.items()):
        _frame(sheet, 2 * number, maps.truths[frame], f"{name}, frame {frame[1]}\n{frame[0]}")
        for column, (method, guess) in enumerate(zip(methods, maps.guesses[frame], strict=True), start=1):
            title = method.label if number == 0 else ""
            value = frame_value(method, frame, "abs_rel")
            titles = (title, f"error, Abs Rel {value:.3f}")
            _pair(sheet, (2 * number, column), guess, maps.truths[frame], titles)
    save(sheet.canvas, path)


def _frame(sheet: Sheet, row: int, truth: Truth, words: str) -> None:
    sheet.image(row, 0, truth.image, words)
    sheet.map(row + 1, 0, "depth", truth.depth, truth.mask, "true depth")


def _pair(sheet: Sheet, place: tuple[int, int], guess: Guess, truth: Truth, titles: tuple[str, str]) -> None:
    row, column = place
    sheet.map(row, column, "depth", guess.depth, truth.mask, titles[0])
    sheet.map(row + 1, column, "error", guess.error, truth.mask, titles[1])
