"""Replies to a visitor's input, independent of the page itself."""

import html
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from col3d.errors import DataError, UserError
from col3d.inference.cameras import CameraOption, lenses
from col3d.inference.demo.answer import Answer, answer
from col3d.inference.demo.clips import CLIP_SIDE, write_clip
from col3d.inference.demo.points import write_points
from col3d.inference.demo.uploads import is_video, pictures_in, read_clip, read_photo, read_truth
from col3d.inference.predictor import Predictor
from col3d.runs.known_failures import is_out_of_memory

PINHOLE, UNKNOWN = "pinhole", "unknown"
NOTHING_YET = "Choose an image or a short video, or click one of the examples."


def cameras() -> dict[str, str]:
    """Return the choices of a camera: values by caption."""
    known = {part.facts["label"]: name for name, part in lenses().items()}
    return {**known, "own pinhole": PINHOLE, "unknown": UNKNOWN}


@dataclass(frozen=True)
class Question:
    """A visitor's input.

    Attributes:
        file: path of the image or video; None before there is one.
        truth: path of its true depth, if any.
        camera: a value of `cameras()`.
        pinhole: fx, fy, cx, cy in pixels; ignored for other cameras.
    """

    file: str | None
    truth: str | None
    camera: str
    pinhole: tuple[float | None, ...]

    @property
    def option(self) -> CameraOption:
        """The camera as the option of programs.

        Raises:
            DataError: the pinhole has no focal lengths.
        """
        if self.camera != PINHOLE:
            return None if self.camera == UNKNOWN else self.camera
        numbers = [float(number or 0) for number in self.pinhole]
        if min(numbers[:2]) <= 0:
            raise DataError("camera: a pinhole needs fx, fy, cx and cy, in pixels of the image")
        return numbers


@dataclass(frozen=True)
class Reply:
    """Content for the page: a message, and an answer or a video, or neither if the input was refused."""

    words: str
    refused: bool = False
    answer: Answer | None = None
    cloud: str | None = None
    video: str | None = None


def reply(network: Predictor, question: Question, folder: Path, progress: Callable[[float], None]) -> Reply:
    """Read and predict a visitor's input; bad input gives a message and raises nothing.

    Args:
        network: the predictor.
        question: the visitor's input.
        folder: folder for files that the page shows.
        progress: called with the share of a video that is done.
    """
    if question.file is None:
        return Reply(NOTHING_YET)
    try:
        path = Path(question.file)
        return (
            _of_video(network, path, question, folder, progress)
            if is_video(path)
            else _of_image(network, path, question, folder)
        )
    except (DataError, UserError) as error:
        return Reply(html.escape(str(error)), refused=True)
    except Exception as error:
        if not is_out_of_memory(error):
            raise
        return Reply("memory is out; take a smaller image or a shorter video", refused=True)


def _of_image(network: Predictor, path: Path, question: Question, folder: Path) -> Reply:
    image = read_photo(path)
    truth = None if question.truth is None else read_truth(Path(question.truth), image.shape[:2])
    response = answer(network, image, question.option, truth)
    several = pictures_in(path)
    first = f"; the first of {several} pictures in it" if several > 1 else ""
    if response.camera is None:
        aside = "" if truth is None else "; the true depth, in mm, is left aside"
        return Reply(_words(path.name, response) + aside + first, answer=response)
    cloud = _new_file(folder, ".ply")
    write_points(response, cloud)
    return Reply(_words(path.name, response) + first, answer=response, cloud=str(cloud))


def _of_video(
    network: Predictor, path: Path, question: Question, folder: Path, progress: Callable[[float], None]
) -> Reply:
    clip = read_clip(path, CLIP_SIDE)
    video = _new_file(folder, ".mp4")
    low, high = write_clip(network, clip, question.option, video, progress)
    unit = "" if question.option is None else " mm"
    words = f"{len(clip.frames)} frames, depth {low:.2g} to {high:.2g}{unit}"
    if question.option is None:
        words += "; relative depth, no metric claim: the camera is unknown"
    return Reply(f"<b>{html.escape(path.name)}</b>: {words}", video=str(video))


def _words(name: str, response: Answer) -> str:
    height, width = response.depth.shape
    begin = f"<b>{html.escape(name)}</b>, shown at {width} x {height}: "
    if response.camera is None:
        return f"{begin}relative depth, no metric claim and no points, for the camera is unknown"
    low, high = response.span
    words = f"{begin}depth {low:.1f} to {high:.1f} mm"
    if not response.known_lens:
        words += "; the network was not trained with this lens, take millimetres with caution"
    return words


def _new_file(folder: Path, ending: str) -> Path:
    with tempfile.NamedTemporaryFile(dir=folder, suffix=ending, delete=False) as file:
        return Path(file.name)


def scores_table(scores: Mapping[str, float]) -> str:
    """Format metrics as an HTML table."""
    rows = "".join(f"<tr><td>{name}</td><td>{value:.3f}</td></tr>" for name, value in scores.items())
    return f"<table><tr><th>Depth against the truth</th><th></th></tr>{rows}</table>"
