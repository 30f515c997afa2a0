"""Which frames are worth a picture."""

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
    """Frames with what is wrong with each or with its video, and one healthy frame of every other video.

    Args:
        plans: of the videos.
        reports: of their frames.
        findings: of all.
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
    there = {(video, frame.number): frame for video, plan in plans.items() for frame in plan.frames}
    in_turn = dict.fromkeys(place for row in zip_longest(*kinds.values()) for place in row if place in there)
    shown = [(there[place], wrong[place]) for place in list(in_turn)[:MOST]]
    of_videos = {finding.video for finding in findings if finding.fault and finding.frame is None}
    healthy = [place for place in middle.items() if place[0] not in of_videos and place not in wrong]
    return shown + [(there[place], []) for place in healthy]


def _middle(reports: Mapping[str, Sequence[FrameReport]], findings: Sequence[Finding]) -> dict[str, int]:
    """Of each video the middle one of the frames that were decoded and have no fault of their own."""
    faulty = {(finding.video, finding.frame) for finding in findings if finding.fault}
    found: dict[str, int] = {}
    for video, of_it in reports.items():
        good = [r.number for r in of_it if r.in_full and (video, r.number) not in faulty]
        if good:
            found[video] = good[len(good) // 2]
    return found
