"""Summarise a whole video once all its frames are checked, and find duplicate pictures."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from col3d.data.checks.findings import FrameReport, Reprojection, VideoReport
from col3d.data.checks.normals import conclude_normals
from col3d.data.checks.video import Plan
from col3d.data.datasets.c3vd import C3VD
from col3d.data.datasets.frame_set import FrameSet
from col3d.data.datasets.release import RELEASES

WORST_REPROJECTION = 0.5
"""Millimetres; C3VD's own frames have 0.002 to 0.045."""
FAR = 10.0
"""Millimetres between neighbouring cameras from which on folds hide much of what the other sees; C3VD's own
are less than 1 apart."""


@dataclass(frozen=True)
class ExpectedVideo:
    """Expected properties of a video.

    Attributes:
        frames: number of frames by release; empty where it is not known.
        exactly: whether another number of frames is a fault, not a note.
        release: release that it should follow, or `auto`.
        poses: whether pose.txt has to exist.
    """

    frames: Mapping[str, int]
    exactly: bool = True
    release: str = "auto"
    poses: bool = False


def summarise_video(
    frames: FrameSet, plan: Plan, reports: Sequence[FrameReport], expected: ExpectedVideo
) -> VideoReport:
    """Summarise a video: statistics over its frames, and checks of normals, count and poses.

    Args:
        frames: frames of the data set.
        plan: plan of the video.
        reports: reports of its frames.
        expected: expected properties of the video.
    """
    video = VideoReport(plan.video, str(plan.folder), frames.camera.size_hw, frames=len(plan.frames))
    video.findings = [*plan.findings, *(finding for report in reports for finding in report.findings)]
    if not plan.frames:
        video.fault("count", f"{plan.folder}: no frames {frames.example} in it")
        return video
    video.in_full = sum(report.in_full for report in reports)
    video.low = _over(np.min, [report.low for report in reports])
    video.high = _over(np.max, [report.high for report in reports])
    video.unknown = _over(np.mean, [report.unknown for report in reports])
    video.outside = _over(np.mean, [report.outside for report in reports])
    video.release = _release_of_names(plan) if isinstance(frames, C3VD) else ""
    video.flow = _over(np.median, [report.flow for report in reports])
    conclude_normals(video, plan, reports, expected.release)
    _conclude_count(video, expected)
    _conclude_poses(video, plan, reports, expected)
    return video


def duplicates(
    videos: Mapping[str, VideoReport], plans: Mapping[str, Plan], reports: Iterable[FrameReport]
) -> None:
    """Report frames whose picture is that of an earlier frame, in their own video or another.

    Args:
        videos: reports of videos by name, which this adds to.
        plans: plans of videos by name.
        reports: reports of the frames of all videos.
    """
    first: dict[str, FrameReport] = {}
    for report in reports:
        before = first.setdefault(report.digest, report) if report.digest else report
        if before is not report:
            videos[report.video].duplicates += 1
            path, same = (plans[r.video].path(r.number, "color") for r in (report, before))
            text = f"{path}: expected a picture of its own, got that of {before.video}/{same.name}"
            videos[report.video].fault("duplicate", text, report.number)


def _over(function: Callable[[Sequence[float]], float], values: Sequence[float]) -> float:
    known = [value for value in values if not math.isnan(value)]
    return float(function(known)) if known else math.nan


def _release_of_names(plan: Plan) -> str:
    """Release by the names of C3VD's files, without normals: before May 2023 numbers are not padded."""
    first = plan.frames[0]
    padded = any(path.name.split("_")[0] == f"{first.number:04d}" for path in first.files.values())
    return RELEASES[0 if padded else 1]


def _conclude_count(video: VideoReport, expected: ExpectedVideo) -> None:
    video.expected = expected.frames.get(video.release)
    if video.expected not in (None, video.frames):
        text = (
            f"{video.folder}: expected {video.expected} frames (release {video.release}), got {video.frames}"
        )
        if expected.exactly:
            video.fault("count", f"{text}; copy it again, or set data.allow_missing=true")
        else:
            video.note("count", text)


def _conclude_poses(
    video: VideoReport, plan: Plan, reports: Sequence[FrameReport], expected: ExpectedVideo
) -> None:
    video.poses = plan.lines is not None
    if plan.lines is None:
        tell = video.fault if expected.poses else video.note
        tell("poses", f"{plan.folder}: no poses: it has no pose.txt")
        return
    _check_lines(video, plan, plan.lines)
    pairs = {report.number: report.reprojection for report in reports if report.reprojection is not None}
    medians = [pair.median for pair in pairs.values() if not math.isnan(pair.median)]
    video.pairs = len(medians)
    video.reprojection, video.worst_reprojection = _over(np.median, medians), _over(np.max, medians)
    for number, pair in pairs.items():
        if wrong := _wrong_reprojection(pair):
            text = f"{plan.folder / 'pose.txt'}: expected poses that carry the depth of frame {number} into "
            text += f"frame {pair.to}, {pair.step:.1f} mm on, got {wrong}"
            if pair.to == number + 1 and not _is_hidden(pair):
                video.fault("reprojection", text, number)
            else:
                video.note("reprojection", f"{text}; folds between them may hide it")


def _wrong_reprojection(pair: Reprojection) -> str:
    if math.isnan(pair.median):
        return f"only {pair.seen:.0%} of its points inside it"
    off = f"a median difference of {pair.median:.2f} mm (at most {WORST_REPROJECTION})"
    return off if pair.median > WORST_REPROJECTION else ""


def _is_hidden(pair: Reprojection) -> bool:
    """Whether a fold between two cameras far apart explains a difference: some of the points still fit."""
    return pair.step > FAR and pair.tenth < WORST_REPROJECTION


def _check_lines(video: VideoReport, plan: Plan, lines: int) -> None:
    """Check for one line a frame; in a partial copy of a video, for a line for each frame that exists."""
    last = plan.frames[-1].number
    whole = last == len(plan.frames) - 1
    if last >= lines or (whole and lines != len(plan.frames)):
        text = (
            f"expected a line for each of {len(plan.frames)} frames, the last of which is {last}, got {lines}"
        )
        video.fault("poses", f"{plan.folder / 'pose.txt'}: {text}")
