"""Maps of one frame: the truth, and a method's prediction with its errors."""

from dataclasses import dataclass

import numpy as np

from col3d.reports.figures.figure import MissingError
from col3d.reports.figures.material import Method, predictions_folder
from col3d.reports.predictions import StoredPredictions

Frame = tuple[str, int]
"""A video and a number."""


@dataclass(frozen=True)
class Truth:
    """Image (h, w, 3) in [0, 1], depth (h, w) in mm, normals (h, w, 3); masks (h, w) of what counts."""

    image: np.ndarray
    depth: np.ndarray
    normals: np.ndarray | None
    mask: np.ndarray
    mask_of_normals: np.ndarray
    occlusion: np.ndarray | None = None
    """Where another surface lies behind the seen one."""


@dataclass(frozen=True)
class Guess:
    """Depth in mm and its absolute error; normals and their error in degrees, where they are predicted."""

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
    except (OSError, KeyError):
        raise MissingError(f"the truth of frame {frame[1]} of {frame[0]} is not in {stored.folder}") from None
    mask = (depth > 0) & (depth < stored.facts["max_depth"])
    known = np.zeros_like(mask) if normals is None else np.linalg.norm(normals, axis=-1) > 0.5
    return Truth(image, depth, normals, mask, mask & known, occlusion)


def read_guess(method: Method, frame: Frame, truth: Truth) -> Guess:
    """What a method's shown run predicted, as the network gave it, without any scaling to the truth.

    Raises:
        MissingError: the frame is not kept, or its size is not that of the truth.
    """
    run = method.shown
    try:
        depth, normals = StoredPredictions(predictions_folder(run)).read(*frame)
    except (OSError, ValueError, KeyError):
        raise MissingError(
            f"frame {frame[1]} of {frame[0]} is not in the predictions of {run.name}"
        ) from None
    if depth.shape != truth.depth.shape:
        raise MissingError(
            f"the truth is kept at {_size(truth.depth)} pixels, predictions of {run.name} are {_size(depth)}"
        )
    angle = None if normals is None or truth.normals is None else angle_between(normals, truth.normals)
    return Guess(depth, np.abs(depth - truth.depth), normals, angle)


def angle_between(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Degrees between vectors (..., 3), also where they are nearly parallel; 0 where one has no length."""
    a, b = one.astype(np.float64), other.astype(np.float64)
    sine = np.linalg.norm(np.cross(a, b), axis=-1)
    return np.degrees(np.arctan2(sine, (a * b).sum(axis=-1)))


def frame_value(method: Method, frame: Frame, metric: str) -> float:
    """A metric of the shown run on a frame, as `per_frame.csv` has it; NaN where it has not."""
    frames = method.shown.frames
    rows = np.flatnonzero((frames["video"] == frame[0]) & (frames["frame"] == frame[1]))
    return float(frames[metric][rows[0]]) if len(rows) else float("nan")


def _size(values: np.ndarray) -> str:
    return " x ".join(map(str, values.shape[:2]))
