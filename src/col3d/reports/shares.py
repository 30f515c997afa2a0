"""How much of the training each segment of the colon makes up, told from a run's config.yaml."""

import csv
import re
from functools import cache
from importlib.resources import files
from typing import Any

from col3d.reports.options import at

BEFORE_2023_05 = {"sigmoid_t1_a": 800}
"""Frames of videos that the earlier release of C3VD holds more of."""


def training_frames(options: dict[str, Any]) -> dict[str, int] | None:
    """Segment -> frames on the list of training videos; None where a video's length is not known."""
    found: dict[str, int] = {}
    for entry in at(options, "data.split.train") or ():
        name, _, last = str(entry).partition(":")
        video = _videos().get(name)
        if video is None:
            return None
        length = _length(options, video, last)
        found[video["segment"]] = found.get(video["segment"], 0) + length
    return found or None


def _length(options: dict[str, Any], video: dict[str, str], limits: str) -> int:
    if match := re.fullmatch(r"(\d+)-(\d+)", limits):
        return int(match.group(2)) - int(match.group(1)) + 1
    if at(options, "data.name") == "phantom":
        return int(at(options, "phantom.frames_per_video") or 1)
    earlier = BEFORE_2023_05 if at(options, "data.release") == "pre_2023_05" else {}
    return earlier.get(video["video"], int(video["frames"]))


@cache
def _videos() -> dict[str, dict[str, str]]:
    """Rows of the table of videos by each of their names: of then, of today, and in the paper."""
    text = files("col3d").joinpath("data/datasets/videos.csv").read_text("utf-8")
    rows = list(csv.DictReader(text.splitlines()))
    names = ("label", "released_as", "video")
    return {row[name]: row for name in names for row in rows if row[name]}
