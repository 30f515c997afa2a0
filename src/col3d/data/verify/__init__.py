"""Checks of a whole data set as it lies on disk: every file, every frame, what normals and poses mean.

Nothing here ends at the first fault: what is wrong is collected as findings, each of which names the file,
the rule and what came.
"""

from col3d.data.verify.conclude import Asked, conclude, duplicates
from col3d.data.verify.conventions import CONVENTIONS, Convention, ranked
from col3d.data.verify.findings import Finding, FrameReport, VideoReport
from col3d.data.verify.lens import conclude_lens
from col3d.data.verify.shown import frames_to_show
from col3d.data.verify.thumbnails import Thumbnail, thumbnail
from col3d.data.verify.video import Plan, check_chunk, plan_video
from col3d.data.verify.work import WholeReport, check

__all__ = [
    "CONVENTIONS",
    "Asked",
    "Convention",
    "Finding",
    "FrameReport",
    "Plan",
    "Thumbnail",
    "VideoReport",
    "WholeReport",
    "check",
    "check_chunk",
    "conclude",
    "conclude_lens",
    "duplicates",
    "frames_to_show",
    "plan_video",
    "ranked",
    "thumbnail",
]
