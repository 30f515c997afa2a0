"""Checks of a whole data set on disk: every file, every frame, the meaning of normals and poses.

The checks do not end at the first fault: faults are collected as findings, each of which names the file,
the rule and what was found.
"""

from col3d.data.checks.conventions import CONVENTIONS, Convention, ranked
from col3d.data.checks.findings import Finding, FrameReport, VideoReport
from col3d.data.checks.lens import conclude_lens
from col3d.data.checks.shown import frames_to_show
from col3d.data.checks.thumbnails import Thumbnail, thumbnail
from col3d.data.checks.video import Plan, check_chunk, plan_video
from col3d.data.checks.video_summary import ExpectedVideo, duplicates, summarise_video
from col3d.data.checks.work import WholeReport, check

__all__ = [
    "CONVENTIONS",
    "Convention",
    "ExpectedVideo",
    "Finding",
    "FrameReport",
    "Plan",
    "Thumbnail",
    "VideoReport",
    "WholeReport",
    "check",
    "check_chunk",
    "conclude_lens",
    "duplicates",
    "frames_to_show",
    "plan_video",
    "ranked",
    "summarise_video",
    "thumbnail",
]
