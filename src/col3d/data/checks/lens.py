"""Check that lens, poses and depth of a video fit together, against other readings of the lens."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np
import torch

from col3d.data.checks.findings import VideoReport
from col3d.data.checks.frame import read_depth
from col3d.data.checks.reproject import surface_error
from col3d.data.checks.video import Plan
from col3d.data.datasets.frame_set import FrameSet
from col3d.geometry import Camera, OmnidirectionalCamera

GROUPS, IN_GROUP = 3, 3
"""Number of places of a video, and of frames at each, whose depth is compared in pairs."""
APART = 30
"""Distance between frames of a place: far enough to tell lenses apart, near enough to see the same wall."""
BELONGS = 0.05
"""Millimetres up to which a lens fits depth and poses; C3VD's own fits to 0.0005."""
BETTER = 2.0
"""Factor by which another reading of the lens has to fit better to be called the right one."""


@dataclass(frozen=True)
class LensReport:
    """Error of each reading of the lens in carrying depth from frame to frame.

    Attributes:
        pairs: number of pairs of frames that were compared.
        errors: by reading, the median over the pairs of the median |z - depth there| in mm; the first is the
            camera's own.
    """

    pairs: int
    errors: Mapping[str, float]


def check_lens(frames: FrameSet, plan: Plan) -> LensReport:
    """Compare a few frames of a video in pairs, through each reading of its lens.

    Args:
        frames: frames of the data set.
        plan: plan of the video.
    """
    torch.set_num_threads(1)
    readings = readings_of(frames)
    errors: list[list[float]] = []
    able = [n for n, frame in plan.numbers.items() if n in plan.poses and "depth" in frame.files]
    for group in _groups(able):
        read = {number: read_depth(frames, plan.numbers[number]) for number in group}
        depths = {number: depth for number, depth in read.items() if depth is not None}
        for one, other in permutations(depths, 2):
            pair, poses = (depths[one], depths[other]), (plan.poses[one], plan.poses[other])
            distances = [surface_error(*pair, poses, camera) for camera in readings.values()]
            if np.isfinite(distances).all():
                errors.append(distances)
    if not errors:
        return LensReport(0, {})
    medians = np.median(np.array(errors), axis=0).tolist()
    return LensReport(len(errors), dict(zip(readings, medians, strict=True)))


def readings_of(frames: FrameSet) -> dict[str, Camera]:
    """The camera of a data set, and of an omnidirectional one the other readings of its stretch matrix."""
    lens = frames.calibrated
    if not isinstance(lens, OmnidirectionalCamera):
        return {"as given": frames.camera}
    return {name: form.resized(frames.camera.size_hw) for name, form in lens.stretch_forms().items()}


def conclude_lens(video: VideoReport, report: LensReport) -> None:
    """Record the errors of a lens, and a fault where another reading of it fits better.

    Args:
        video: report of the video, which this adds to.
        report: report of its lens.
    """
    video.lens, video.lens_pairs = dict(report.errors), report.pairs
    if not report.errors:
        return
    own, best = next(iter(report.errors)), min(report.errors, key=lambda name: report.errors[name])
    least = report.errors[best]
    if least <= BELONGS and report.errors[own] > BETTER * least:
        video.fault(
            "lens",
            f"{video.folder}: expected depth and poses seen through the stretch matrix {own}, which carries "
            f"depth from frame to frame to {report.errors[own]:.4f} mm, and {best} does to {least:.4f}",
        )


def _groups(numbers: Sequence[int]) -> list[list[int]]:
    """Frames to compare: all of a short video, else a few neighbours at a few places."""
    count = len(numbers)
    if count <= GROUPS * IN_GROUP:
        return [list(numbers)]
    apart = max(1, min(APART, count // (GROUPS * IN_GROUP)))
    length = apart * (IN_GROUP - 1)
    firsts = [round(place * (count - 1 - length) / (GROUPS - 1)) for place in range(GROUPS)]
    return [list(numbers[first : first + length + 1 : apart]) for first in firsts]
