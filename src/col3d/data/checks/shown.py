"""Choose the frames that the page of a verification shows."""

from collections.abc import Mapping, Sequence
from itertools import zip_longest

from col3d.data.checks.findings import Finding, FrameReport
from col3d.data.checks.video import Plan
from col3d.data.datasets.frame_files import Frame

MOST = 40
Place = tuple[str, int]
"""A video and the number of a frame."""


def frames_to_show(
    plans: Mapping[str, Plan], reports: Mapping[str, Sequence[FrameReport]], findings: Sequence[Finding]
) -> list[tuple[Frame, list[str]]]:
    """Frames with the faults of each or of its video, and one healthy frame of every other video.

    Args:
        plans: plans of the videos.
        reports: reports of their frames.
        findings: findings on all of them.
    """
    middle = _middle(reports, findings)
    wrong: dict[Place, list[str]] = {}
    kinds: dict[tuple[str, str], list[Place]] = {}
    for finding in findings:
        number = middle.get(finding.video) if finding.frame is None else finding.frame
        if finding.fault and number is not None:
            place = (finding.video, number)
            wrong.setdefault(place, []).append(finding.text)
            kinds.setdefault((finding.video, finding.rule), []).append(place)
    known = {(video, frame.number): frame for video, plan in plans.items() for frame in plan.frames}
    in_turn = dict.fromkeys(place for row in zip_longest(*kinds.values()) for place in row if place in known)
    shown = [(known[place], wrong[place]) for place in list(in_turn)[:MOST]]
    faulty_videos = {finding.video for finding in findings if finding.fault and finding.frame is None}
    healthy = [place for place in middle.items() if place[0] not in faulty_videos and place not in wrong]
    return shown + [(known[place], []) for place in healthy]


def _middle(reports: Mapping[str, Sequence[FrameReport]], findings: Sequence[Finding]) -> dict[str, int]:
    """Of each video, the middle one of the frames that were decoded and have no fault of their own."""
    faulty = {(finding.video, finding.frame) for finding in findings if finding.fault}
    middles: dict[str, int] = {}
    for video, frame_reports in reports.items():
        good = [r.number for r in frame_reports if r.in_full and (video, r.number) not in faulty]
        if good:
            middles[video] = good[len(good) // 2]
    return middles
