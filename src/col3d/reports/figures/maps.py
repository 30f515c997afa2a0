"""Maps of one frame: the truth, and a method's prediction with its errors."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from col3d.errors import DataError
from col3d.io.predictions import StoredPredictions
from col3d.reports.figures.figure import MissingError
from col3d.reports.figures.figure_data import Method, predictions_folder

Frame = tuple[str, int]
"""Name of a video and number of the frame."""


@dataclass(frozen=True)
class Truth:
    """Image (h, w, 3) in [0, 1], depth (h, w) in mm, normals (h, w, 3); masks (h, w) of what counts."""

    image: np.ndarray
    depth: np.ndarray
    normals: np.ndarray | None
    mask: np.ndarray
    mask_of_normals: np.ndarray
    occlusion: np.ndarray | None = None
    """Where another surface lies behind the visible one."""


@dataclass(frozen=True)
class Guess:
    """A prediction: depth in mm and its absolute error; normals and their error in degrees, if predicted."""

    depth: np.ndarray
    error: np.ndarray
    normals: np.ndarray | None
    angle: np.ndarray | None


def read_truth(stored: StoredPredictions, frame: Frame) -> Truth:
    """The truth of a frame.

    Raises:
        MissingError: it is not kept.
    """
    try:
        (depth, normals), image = stored.read(*frame), stored.read_image(*frame)
        occlusion = stored.read_occlusion(*frame)
    except DataError as error:
        raise MissingError(str(error)) from None
    except (FileNotFoundError, KeyError):
        raise MissingError(f"the truth of frame {frame[1]} of {frame[0]} is not in {stored.folder}") from None
    mask = (depth > 0) & (depth < stored.facts["max_depth"])
    known = np.zeros_like(mask) if normals is None else np.linalg.norm(normals, axis=-1) > 0.5
    return Truth(image, depth, normals, mask, mask & known, occlusion)


def read_guess(method: Method, frame: Frame, truth: Truth) -> Guess:
    """Prediction of a method's shown run, as the network gave it, without any scaling to the truth.

    Raises:
        MissingError: the frame is not kept, or its size is not that of the truth.
    """
    run = method.shown
    try:
        depth, normals = StoredPredictions(predictions_folder(run)).read(*frame)
    except (FileNotFoundError, KeyError):
        raise MissingError(
            f"frame {frame[1]} of {frame[0]} is not in the predictions of {run.name}"
        ) from None
    except DataError as error:
        raise MissingError(str(error)) from None
    if depth.shape != truth.depth.shape:
        raise MissingError(
            f"the truth is kept at {_size(truth.depth)} pixels, predictions of {run.name} are {_size(depth)}"
        )
    angle = None if normals is None or truth.normals is None else angle_between(normals, truth.normals)
    return Guess(depth, np.abs(depth - truth.depth), normals, angle)


@dataclass(frozen=True)
class Maps:
    """The truth of frames, and for each frame the prediction of every method, in their order."""

    truths: dict[Frame, Truth]
    guesses: dict[Frame, list[Guess]]

    @property
    def pairs(self) -> list[tuple[Guess, Truth]]:
        """Every prediction with its truth."""
        return [(guess, self.truths[frame]) for frame, guesses in self.guesses.items() for guess in guesses]

    @property
    def depths(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """True depth of each frame and its mask."""
        return [(truth.depth, truth.mask) for truth in self.truths.values()]

    @property
    def errors(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Absolute errors of depth and their masks."""
        return [(guess.error, truth.mask) for guess, truth in self.pairs]

    @property
    def angles(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Angular errors and their masks, of those that have normals."""
        return [
            (guess.angle, truth.mask_of_normals) for guess, truth in self.pairs if guess.angle is not None
        ]


def read_maps(stored: StoredPredictions, methods: Sequence[Method], frames: Iterable[Frame]) -> Maps:
    """Truth and predictions of frames.

    Raises:
        MissingError: a map is not kept.
    """
    truths = {frame: read_truth(stored, frame) for frame in frames}
    guesses = {frame: [read_guess(m, frame, truth) for m in methods] for frame, truth in truths.items()}
    return Maps(truths, guesses)


def angle_between(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Degrees between vectors (..., 3), also where they are nearly parallel; 0 where one has no length."""
    a, b = one.astype(np.float64), other.astype(np.float64)
    sine = np.linalg.norm(np.cross(a, b), axis=-1)
    return np.degrees(np.arctan2(sine, (a * b).sum(axis=-1)))


def frame_value(method: Method, frame: Frame, metric: str) -> float:
    """A metric of the shown run on a frame, from `per_frame.csv`; NaN where it has no value."""
    frames = method.shown.frames
    rows = np.flatnonzero((frames["video"] == frame[0]) & (frames["frame"] == frame[1]))
    return float(method.shown.values(metric)[rows[0]]) if len(rows) else float("nan")


def _size(values: np.ndarray) -> str:
    return " x ".join(map(str, values.shape[:2]))
