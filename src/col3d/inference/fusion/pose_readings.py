"""Interpretations of the matrices of a pose file, and the one that fits depth of neighbouring frames."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from jaxtyping import Float64

from col3d.data.checks.frame import read_depth
from col3d.data.checks.reproject import reproject
from col3d.data.datasets.frame_files import Frame
from col3d.data.datasets.frame_set import Depth, FrameSet
from col3d.errors import DataError

DIRECTIONS = ("camera_to_world", "world_to_camera")
AXES: Mapping[str, tuple[float, float, float]] = {
    "opencv": (1.0, 1.0, 1.0),
    "opengl": (1.0, -1.0, -1.0),
    "unity": (1.0, -1.0, 1.0),
}
"""Signs of x right, y down, z forward: OpenGL and Blender have y up and z back, Unity (left-handed) y up."""
UNITS: Mapping[str, float] = {"mm": 1.0, "cm": 10.0, "m": 1000.0}
"""Millimetres of one unit of a translation."""
GAPS, PLACES = (1, 2, 4, 8, 16, 32), 2
"""Distances between two frames that are compared, and number of places in the video."""
BETTER, NOISE = 3.0, 0.01
"""Factor, and mm beyond it, by which another reading has to fit better to be the right one."""
ALIKE = 1.1
"""Readings within this factor of the best one are as good; the one that changes least is taken."""
IDLE = 0.7
"""Share of the error without any motion above which poses explain nothing."""
AUTO = "auto"

Poses = Float64[np.ndarray, "n 4 4"]


@dataclass(frozen=True)
class PoseReading:
    """Interpretation of a pose's matrix.

    Attributes:
        direction: `camera_to_world` or `world_to_camera`.
        axes: convention of the camera's axes; see `AXES`.
        unit: unit of its translation; see `UNITS`.
        first: number of the frame that the first matrix belongs to.
    """

    direction: str = "camera_to_world"
    axes: str = "opencv"
    unit: str = "mm"
    first: int = 0

    @classmethod
    def of(cls, options: Mapping[str, str | int]) -> "PoseReading":
        """From the value of each field, where `auto` stands for C3VD's."""
        return cls(**{name: value for name, value in options.items() if value != AUTO})  # type: ignore[arg-type]

    def camera_to_world(self, stored: Poses) -> Poses:
        """Matrices that take points of the camera (OpenCV axes, mm) to a right-handed world."""
        poses = np.linalg.inv(stored) if self.direction == "world_to_camera" else stored.copy()
        poses[:, :3, 3] *= UNITS[self.unit]
        signs = np.diag([*AXES[self.axes], 1.0])
        return signs @ poses @ signs

    def of_frame(self, poses: Poses, number: int) -> np.ndarray | None:
        """The matrix of a frame; None where it has none."""
        place = number - self.first
        return poses[place] if 0 <= place < len(poses) else None

    def differs(self, other: "PoseReading") -> str:
        """Options of another reading that differ from this one, as they are typed."""
        names = [name for name in vars(self) if getattr(self, name) != getattr(other, name)]
        return " ".join(f"poses.{name}={getattr(other, name)}" for name in names)


@dataclass(frozen=True)
class PosesFound:
    """The reading of poses, and how well depth fits it.

    Attributes:
        reading: the requested reading, or the one that fits depth where `auto` leaves it open.
        apart: median over pairs of frames of the median |z - depth there| in mm; None where no two frames see
            the same.
        note: what depth has decided, as text; empty where it decided nothing.
    """

    reading: PoseReading
    apart: float | None
    note: str = ""


def find_reading(frames: FrameSet, stored: Poses, options: Mapping[str, str | int]) -> PosesFound:
    """Find the reading of poses by which depth fits when it is carried between neighbouring frames.

    Args:
        frames: frames of one video, with depth.
        stored: the matrices of its pose file.
        options: value of each field of a `PoseReading`, or `auto`.

    Raises:
        DataError: no reading fits, or only one that contradicts the options.
    """
    given = PoseReading.of(options)
    nowhere = all(given.of_frame(stored, frame.number) is None for frame in frames.frames)
    start = min(frame.number for frame in frames.frames)
    usual = replace(given, first=start) if nowhere and options["first"] == AUTO else given
    readings = sorted(_readings(frames, usual), key=lambda reading: len(usual.differs(reading).split()))
    rows, still = _measured(frames, stored, readings, usual)
    if not rows:
        return PosesFound(usual, None, "no two frames see the same, so that nothing bears the poses out")
    errors = dict(zip(readings, np.median(rows, axis=0).tolist(), strict=True))
    best, unmoved = min(errors.values()), float(np.median(still))
    if not best <= BETTER * unmoved / 2 + NOISE:
        raise DataError(
            f"{_summary(best)} at least, {_mm(unmoved)} if the camera had stood still: no usual reading of "
            "the poses fits; poses.check=false takes them as they are"
        )
    near = [reading for reading in readings if errors[reading] <= BETTER * best + NOISE]
    right = usual
    if usual not in near:
        right = next(reading for reading in readings if errors[reading] <= ALIKE * best)
    if any(value not in (AUTO, getattr(right, name)) for name, value in options.items()):
        raise DataError(f"{_summary(errors[usual])}; {usual.differs(right)} brings it within {_mm(best)}")
    return PosesFound(right, errors[right], _note(given, right, errors, usual, unmoved))


def _note(
    given: PoseReading,
    right: PoseReading,
    errors: Mapping[PoseReading, float],
    usual: PoseReading,
    unmoved: float,
) -> str:
    """Note on what depth has decided, or that the poses explain nothing."""
    apart = errors[right]
    if apart > IDLE * unmoved + NOISE:
        return (
            f"{_summary(apart)}, {_mm(unmoved)} if the camera had stood still: the poses explain nothing of "
            "what changes, and the surface is as wrong as they are"
        )
    if right == given:
        return ""
    instead = "" if right == usual else f" instead of {_mm(errors[usual])}"
    read = f"pose.txt is read with {given.differs(right)}"
    return f"{read}: depth carried from frame to frame is then {_mm(apart)} apart{instead}"


def _measured(
    frames: FrameSet, stored: Poses, readings: Sequence[PoseReading], usual: PoseReading
) -> tuple[list[list[float]], list[float]]:
    """Error in mm of each reading over pairs of frames, and the error without any motion."""
    meanings = {reading: reading.camera_to_world(stored) for reading in readings}
    posed = [frame for frame in frames.frames if usual.of_frame(stored, frame.number) is not None]
    depths: dict[int, Depth | None] = {}
    rows, still = [], []
    for first, second in _pairs(posed):
        for frame in (first, second):
            if frame.number not in depths:
                depths[frame.number] = read_depth(frames, frame)
        one, other = depths[first.number], depths[second.number]
        if one is None or other is None:
            continue
        row = [
            _apart(frames, (one, other), [r.of_frame(poses, f.number) for f in (first, second)])
            for r, poses in meanings.items()
        ]
        if np.isfinite(row).any():
            rows.append(row)
            still.append(_apart(frames, (one, other), [np.eye(4)] * 2))
    return rows, still


def _summary(apart: float) -> str:
    return f"pose.txt: depth carried from frame to frame comes out {_mm(apart)} apart"


def _mm(apart: float) -> str:
    if not np.isfinite(apart):
        return "too far"
    return f"{apart:.2g} mm" if apart < 1 else f"{apart:.1f} mm"


def _readings(frames: FrameSet, usual: PoseReading) -> Iterator[PoseReading]:
    numbers = {0, 1, min(frame.number for frame in frames.frames), usual.first}
    for direction, axes, unit, first in product(DIRECTIONS, AXES, UNITS, sorted(numbers)):
        yield PoseReading(direction, axes, unit, first)


def _pairs(frames: Sequence[Frame]) -> Iterator[tuple[Frame, Frame]]:
    """Pairs of frames at several distances, at places spread over the video."""
    for gap in GAPS:
        if gap < len(frames):
            starts = np.linspace(0, len(frames) - 1 - gap, PLACES).round().astype(int)
            for start in dict.fromkeys(starts.tolist()):
                yield frames[start], frames[start + gap]


def _apart(frames: FrameSet, pair: tuple[Depth, Depth], poses: Sequence[np.ndarray | None]) -> float:
    """Median |z - depth there| in mm; infinite where a pose is missing or too little is seen by both."""
    one, other = poses
    if one is None or other is None:
        return np.inf
    median = reproject(*pair, (one, other), frames.camera, to=0).median
    return median if np.isfinite(median) else np.inf
