"""Coloured point clouds that can be rotated in a page: stored in small files and embedded in the HTML."""

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8

from col3d.io.atomic import whole_file
from col3d.reports.previews import colours

STEPS = 50.0
"""Quantisation steps per mm in files and pages: 16 bits reach 655 mm either way."""
MOST = 30_000
"""Largest number of points of one cloud in a page."""
ERROR_SHARE = 0.98
"""Share of points whose error is below the end of its colours."""


@dataclass(frozen=True)
class Cloud:
    """Points in mm with the image's colours (`seen`), and colours of their errors (`error`) if known."""

    name: str
    points: Float[np.ndarray, "n 3"]
    seen: UInt8[np.ndarray, "n 3"]
    error: UInt8[np.ndarray, "n 3"] | None = None

    def plain(self, centre: np.ndarray) -> dict[str, Any]:
        """The cloud as base64 texts for the page: little-endian steps from the centre, and bytes of RGB."""
        steps = ((self.points - centre) * STEPS).round().clip(-32767, 32767).astype("<i2")
        content = {"name": self.name, "points": _text(steps), "seen": _text(self.seen)}
        return content if self.error is None else content | {"error": _text(self.error)}


@dataclass(frozen=True)
class Scene:
    """Clouds in the same coordinates, beside one another.

    Attributes:
        title: name in the page's list of scenes.
        clouds: rotated together, about the median point of the first.
        largest_error: mm at the upper end of the error colours; None without errors.
        from_camera: whether the coordinates are a camera's; the first view is then from the camera.
    """

    title: str
    clouds: tuple[Cloud, ...]
    largest_error: float | None
    from_camera: bool

    def plain(self) -> dict[str, Any]:
        """The scene as values for JSON."""
        first = self.clouds[0].points
        centre = np.median(first, axis=0)
        reach = float(np.quantile(np.linalg.norm(first - centre, axis=1), 0.95))
        return {
            "title": self.title,
            "clouds": [cloud.plain(centre) for cloud in self.clouds],
            "steps": STEPS,
            "reach": reach,
            "largestError": self.largest_error,
            "fromCamera": self.from_camera,
        }


def save_frame(
    path: Path,
    truth: Float[np.ndarray, "n 3"],
    prediction: Float[np.ndarray, "n 3"],
    seen: UInt8[np.ndarray, "n 3"],
) -> None:
    """Save the true and the predicted points of one frame's pixels, in mm, and their colours."""
    chosen = thinned(len(truth), MOST)
    as_steps = [(points[chosen] * STEPS).round().clip(-32767, 32767) for points in (truth, prediction)]
    with whole_file(path) as file:
        np.savez_compressed(
            file,
            truth=as_steps[0].astype(np.int16),
            prediction=as_steps[1].astype(np.int16),
            seen=seen[chosen],
        )


def read_frame(path: Path) -> Scene:
    """Read the scene of a frame that `save_frame` wrote.

    Raises:
        ValueError: the file does not hold the points of a frame.
    """
    try:
        with np.load(path, allow_pickle=False) as kept:
            truth, prediction = (kept[name].astype(np.float32) / STEPS for name in ("truth", "prediction"))
            seen = kept["seen"]
    except (OSError, KeyError, EOFError, ValueError) as error:
        raise ValueError(f"{path}: no points of a frame ({error})") from None
    off = np.abs(prediction[:, 2] - truth[:, 2])
    largest = max(float(np.quantile(off, ERROR_SHARE)), 0.1) if len(off) else 1.0
    clouds = (
        Cloud("truth", truth, seen),
        Cloud("prediction", prediction, seen, error_colours(off, largest)),
    )
    video, _, number = path.stem.rpartition("_")
    return Scene(f"{video}, frame {int(number)}", clouds, largest, from_camera=True)


def error_colours(off: Float[np.ndarray, " n"], largest: float) -> UInt8[np.ndarray, "n 3"]:
    """Colours of errors from 0 to `largest`; larger errors have the last colour."""
    chosen: np.ndarray = colours("magma")[(off * (255 / largest)).clip(0, 255).astype(np.uint8)]
    return chosen


def thinned(count: int, most: int = MOST) -> Sequence[int] | slice:
    """Indices of the points that are kept: all, or `most` at random, the same each time."""
    if count <= most:
        return slice(None)
    chosen: np.ndarray = np.sort(np.random.default_rng(0).choice(count, most, replace=False))
    return chosen.tolist()


def _text(values: np.ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode("ascii")
