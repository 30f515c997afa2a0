"""Number of training frames of each segment of the colon, from a run's config.yaml."""

import csv
import re
from functools import cache
from importlib.resources import files
from typing import Any

from col3d.reports.options import at

BEFORE_2023_05 = {"sigmoid_t1_a": 800}
"""Number of frames of videos that are longer in the earlier release of C3VD."""


def training_frames(options: dict[str, Any]) -> dict[str, int] | None:
    """Segment -> frames on the list of training videos; None where a video's length is not known."""
    frames: dict[str, int] = {}
    for entry in at(options, "data.split.train") or ():
        name, _, last = str(entry).partition(":")
        video = _videos().get(name)
        if video is None:
            return None
        length = _length(options, video, last)
        frames[video["segment"]] = frames.get(video["segment"], 0) + length
    return frames or None


def _length(options: dict[str, Any], video: dict[str, str], limits: str) -> int:
    if match := re.fullmatch(r"(\d+)-(\d+)", limits):
        return int(match.group(2)) - int(match.group(1)) + 1
    if at(options, "data.name") == "phantom":
        return int(at(options, "phantom.frames_per_video") or 1)
    earlier = BEFORE_2023_05 if at(options, "data.release") == "pre_2023_05" else {}
    return earlier.get(video["video"], int(video["frames"]))


@cache
def _videos() -> dict[str, dict[str, str]]:
    """Rows of the table of videos by each name of a video: in the paper, as released, and in use here."""
    text = files("col3d").joinpath("data/datasets/videos.csv").read_text("utf-8")
    rows = list(csv.DictReader(text.splitlines()))
    names = ("label", "released_as", "video")
    return {row[name]: row for name in names for row in rows if row[name]}
