"""Convention of the stored normals of a video, and frames that do not follow it."""

from collections.abc import Mapping, Sequence

import numpy as np

from col3d.data.checks.conventions import CONVENTIONS, ENCODINGS, Convention, ranked
from col3d.data.checks.findings import FrameReport, VideoReport
from col3d.data.checks.video import Plan
from col3d.data.datasets.release import AGREEMENT

MOST_OFF_LENGTH = 0.01
"""Share of the stored normals that may be off unit length by more than 1 %."""
TIE = 1.0
"""Degrees by which a convention must beat that of a release to be the better one."""
ODD = 3.0
"""Degrees by which another convention must suit a frame better than that of its video."""
SHOWN = 5
"""Number of conventions of the ranking that are kept of a video."""


def conclude_normals(video: VideoReport, plan: Plan, reports: Sequence[FrameReport], release: str) -> None:
    """Find the convention of a video's normals, and compare the release and every frame with it.

    Args:
        video: report of the video, which this adds to.
        plan: plan of the video.
        reports: reports of its frames.
        release: the requested release, or `auto`.
    """
    angles = [report.angles for report in reports if report.angles is not None]
    if not angles:
        return
    ranking = ranked(angles)
    chosen = _best(ranking, release)
    encoding = ENCODINGS.index(chosen.clipped)
    video.ranking = [(convention.called, angle) for convention, angle in list(ranking.items())[:SHOWN]]
    video.normals, video.camera, video.angle = str(chosen), chosen.camera, ranking[chosen]
    video.release = chosen.release or video.release
    lengths = [report.off_length[encoding] for report in reports if report.off_length]
    video.off_length = float(np.mean(lengths))
    if wrong := _wrong(chosen, ranking, release):
        video.fault("normals", f"{video.folder}: {wrong}")
    for report in reports if video.angle <= AGREEMENT else ():
        path = str(plan.path(report.number, "normals"))
        _check_angle(video, report, path, chosen)
        _check_length(video, report, path, encoding)


def _best(ranking: Mapping[Convention, float], release: str) -> Convention:
    """The best convention, or one of a release where that is as good, the requested one first."""
    best = next(iter(ranking))
    near = [c for c in ranking if c.release and ranking[c] <= ranking[best] + TIE]
    return next((c for c in near if c.release == release), near[0] if near else best)


def _wrong(chosen: Convention, ranking: Mapping[Convention, float], release: str) -> str:
    """Fault of the convention of a video; empty where there is none."""
    if ranking[chosen] > AGREEMENT:
        return (
            f"its normals do not belong to its depth: {ranking[chosen]:.0f} degrees apart under the best of "
            f"all conventions, {chosen.called} (at most {AGREEMENT:.0f})"
        )
    if not chosen.release:
        nearest = min((c for c in ranking if c.release), key=lambda c: ranking[c])
        return (
            f"expected normals as a release of C3VD stores them, got {chosen.called}: {ranking[chosen]:.1f} "
            f"degrees from those of the depth, and {ranking[nearest]:.1f} read as {nearest.release}"
        )
    if release not in ("auto", chosen.release):
        return f"its normals follow the release {chosen.release}, and data.release={release}"
    return ""


def _check_angle(video: VideoReport, report: FrameReport, path: str, chosen: Convention) -> None:
    """Report a frame whose normals are those of another frame, or stored differently from the others."""
    if report.angles is None:
        return
    angle, best = float(report.angles[CONVENTIONS.index(chosen)]), int(np.argmin(report.angles))
    if angle > min(AGREEMENT, float(report.angles[best]) + ODD):
        text = (
            f"{path}: expected normals {chosen} of its depth as in the rest of the video, and they are "
            f"{angle:.0f} degrees apart; {report.angles[best]:.0f} read as {CONVENTIONS[best].called}"
        )
        video.fault("normals", text, report.number)


def _check_length(video: VideoReport, report: FrameReport, path: str, encoding: int) -> None:
    if report.off_length and report.off_length[encoding] > MOST_OFF_LENGTH:
        text = (
            f"{path}: expected normals of unit length, got {report.off_length[encoding]:.1%} that are off by "
            f"more than 1% (at most {MOST_OFF_LENGTH:.0%} may be)"
        )
        video.fault("unit length", text, report.number)
