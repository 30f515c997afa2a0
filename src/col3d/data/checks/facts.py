"""Content of verify.json and of its page."""

import statistics
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from col3d.data.checks import (
    Finding,
    FrameReport,
    VideoReport,
    ranked,
    thumbnail,
)
from col3d.data.checks.options import VerifyOptions
from col3d.data.datasets.frame_files import Frame
from col3d.data.datasets.frame_set import FrameSet
from col3d.reports.verification import Picture

BROKEN_WIDTH, HEALTHY_WIDTH = 200, 110
"""Width in pixels of one map of a frame on the page."""
RANKING_SHOWN = 6


def facts_of(
    options: VerifyOptions,
    videos: Mapping[str, VideoReport],
    reports: Iterable[FrameReport],
    findings: Sequence[Finding],
) -> dict[str, Any]:
    """Content of `verify.json`."""
    faults = Counter(finding.video for finding in findings if finding.fault)
    rows = [{**asdict(video), "faults": faults[name]} for name, video in videos.items()]
    for row in rows:
        del row["findings"]  # all findings are listed together, below
    angles = [report.angles for report in reports if report.angles is not None]
    ranking = list(ranked(angles).items())[:RANKING_SHOWN] if angles else []
    return {
        "data": options.data.name,
        "root": str(Path(options.data.root).absolute()),
        "fast": options.fast,
        "frames": sum(video.frames for video in videos.values()),
        "in_full": sum(video.in_full for video in videos.values()),
        "faults": faults.total(),
        "notes": len(findings) - faults.total(),
        "videos": rows,
        "ranking": [
            {"normals": str(c), "camera": c.camera, "release": c.release, "angle": a} for c, a in ranking
        ],
        "lens": _lens(videos.values()),
        "findings": [asdict(finding) for finding in findings],
    }


def _lens(videos: Iterable[VideoReport]) -> list[dict[str, Any]]:
    """Readings of the lens by how well they fit depth and poses over all videos, the best first."""
    measured = [video for video in videos if video.lens]
    names = measured[0].lens if measured else {}
    errors = {name: statistics.median(video.lens[name] for video in measured) for name in names}
    pairs = sum(video.lens_pairs for video in measured)
    return [
        {"reading": name, "error": errors[name], "own": name == next(iter(names)), "pairs": pairs}
        for name in sorted(errors, key=lambda name: errors[name])
    ]


def pictures_of(frames: FrameSet, shown: Iterable[tuple[Frame, list[str]]]) -> list[Picture]:
    """Thumbnails of frames, each with its faults."""
    pictures = []
    for frame, lines in shown:
        small = thumbnail(frames, frame, BROKEN_WIDTH if lines else HEALTHY_WIDTH)
        maps = (small.image, small.depth, small.normals)
        pictures.append(Picture(frame.video, frame.number, lines, *maps))
    return pictures
