"""What comes of a whole video, once all its frames are checked; and pictures that are there twice."""

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
    """What a video should be.

    Attributes:
        frames: how many by release; empty where nothing says so.
        exactly: another number of frames is a fault, not a note.
        release: that it should follow, or `auto`.
        poses: pose.txt has to be there.
    """

    frames: Mapping[str, int]
    exactly: bool = True
    release: str = "auto"
    poses: bool = False


def summarise_video(
    frames: FrameSet, plan: Plan, reports: Sequence[FrameReport], asked: ExpectedVideo
) -> VideoReport:
    """What comes of a video.

    Args:
        frames: of the data set.
        plan: of the video.
        reports: of its frames.
        asked: what it should be.
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
    conclude_normals(video, plan, reports, asked.release)
    _conclude_count(video, asked)
    _conclude_poses(video, plan, reports, asked)
    return video


def duplicates(
    videos: Mapping[str, VideoReport], plans: Mapping[str, Plan], reports: Iterable[FrameReport]
) -> None:
    """Note the frames whose picture was there before, in their own video or another.

    Args:
        videos: by name; this adds to them.
        plans: likewise.
        reports: of the frames of all.
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
    """As C3VD's files tell it where there are no normals: the one before May 2023 does not pad numbers."""
    first = plan.frames[0]
    padded = any(path.name.split("_")[0] == f"{first.number:04d}" for path in first.files.values())
    return RELEASES[0 if padded else 1]


def _conclude_count(video: VideoReport, asked: ExpectedVideo) -> None:
    video.expected = asked.frames.get(video.release)
    if video.expected not in (None, video.frames):
        text = (
            f"{video.folder}: expected {video.expected} frames (release {video.release}), got {video.frames}"
        )
        if asked.exactly:
            video.fault("count", f"{text}; copy it again, or set data.allow_missing=true")
        else:
            video.note("count", text)


def _conclude_poses(
    video: VideoReport, plan: Plan, reports: Sequence[FrameReport], asked: ExpectedVideo
) -> None:
    video.poses = plan.lines is not None
    if plan.lines is None:
        tell = video.fault if asked.poses else video.note
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
    """Whether a fold between two cameras far apart explains it: some of the points fit all the same."""
    return pair.step > FAR and pair.tenth < WORST_REPROJECTION


def _check_lines(video: VideoReport, plan: Plan, lines: int) -> None:
    """One line a frame; of a video that is there in part, a line for each frame that is."""
    last = plan.frames[-1].number
    whole = last == len(plan.frames) - 1
    if last >= lines or (whole and lines != len(plan.frames)):
        text = (
            f"expected a line for each of {len(plan.frames)} frames, the last of which is {last}, got {lines}"
        )
        video.fault("poses", f"{plan.folder / 'pose.txt'}: {text}")
