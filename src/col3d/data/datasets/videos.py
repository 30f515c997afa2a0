"""The videos of C3VD and C3VDv2: their names, labels, splits and contents.

`videos.csv` holds the summary tables of the data sets' own pages (Johns Hopkins Research Data Repository,
doi:10.7281/T1/JC64MK), with the labels and the split of the Col3D-MTL paper beside them. A video of C3VD
goes by the name of its first release here, `cecum_t1_a`; its name since December 2025, `c0_cecum_t1_v1`,
and its label in the paper, `c1v1`, mean the same video wherever a name is read.
"""

import csv
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

PRINTED_LABELS = {"t3v1": "t4v1"}
"""Misprints of the paper's table and what they stand for."""
FRAMES_BEFORE_2023_05 = {"sigmoid_t1_a": 800}
"""Numbers of frames of videos that are longer in the earlier release."""
REGISTERED = "registered"


@dataclass(frozen=True)
class Video:
    """One row of the table.

    Attributes:
        name: its name in this project.
        released_as: its name in the data set today.
        data: c3vd or c3vdv2.
        kind: registered, with depth and normals of every frame; screening or deformation, without.
        frames: number of frames.
        label: its label in the Col3D-MTL paper; empty for videos that are not in it.
        split: part of the paper's split that it is in, or empty.
        colon: the phantom it was filmed in.
        segment: segment of the colon.
        texture: texture painted on the phantom.
    """

    name: str
    released_as: str
    data: str
    kind: str
    frames: int
    label: str
    split: str
    colon: str
    segment: str
    texture: str

    @property
    def has_truth(self) -> bool:
        """Whether its frames have depth and normals."""
        return self.kind == REGISTERED


@cache
def catalogue() -> Mapping[str, Video]:
    """Every video of C3VD and C3VDv2 by its name here."""
    text = files("col3d.data.datasets").joinpath("videos.csv").read_text(encoding="utf-8")
    videos = {}
    for row in csv.DictReader(text.splitlines()):
        name, split, frames = row.pop("video"), row.pop("paper_split"), int(row.pop("frames"))
        videos[name] = Video(name=name, split=split, frames=frames, **row)
    return videos


@cache
def video_table() -> Mapping[str, Video]:
    """The 22 registered videos of C3VD by name."""
    return {name: v for name, v in catalogue().items() if v.data == "c3vd" and v.has_truth}


UNDER_REVIEW = "_under_review"
"""Ending of the names of folders while the data set was under review."""


@cache
def other_names() -> Mapping[str, str]:
    """Today's names and labels of the paper -> the name here."""
    names = {v.released_as: v.name for v in catalogue().values() if v.released_as != v.name}
    labels = {v.label: v.name for v in catalogue().values() if v.label}
    return names | labels | {printed: labels[label] for printed, label in PRINTED_LABELS.items()}


def canonical_name(name: str) -> str:
    """The name here of a video, whichever of its names is given; any other name unchanged."""
    origin, seed = _without_seed(name.removesuffix(UNDER_REVIEW))
    name_here = other_names().get(origin, origin)
    return name_here + seed if name_here in catalogue() else name


def seeded_name(video: str, seed: int) -> tuple[str, int]:
    """Split a phantom's name with a seed of its own, `cecum_t1_a_s7`, into name and seed; else as given."""
    origin, suffix = _without_seed(video)
    return (origin, int(suffix[2:])) if suffix and origin in video_table() else (video, seed)


def seeded_videos(first: int, last: int) -> list[str]:
    """Names of a phantom's videos number `first` to `last`: all of C3VD's of seed 0, then of seed 1, ..."""
    names = list(video_table())
    return [f"{names[k % len(names)]}_s{k // len(names)}" for k in range(first, last + 1)]


def described(video: str) -> Video | None:
    """The row of a video, or of the one that a phantom's video is named after."""
    return catalogue().get(seeded_name(canonical_name(video), 0)[0])


def describe(video: str) -> tuple[str, str]:
    """Segment and texture of a video, empty where the table does not list it."""
    row = described(video)
    return (row.segment, row.texture) if row else ("", "")


def frames_of(video: str, release: str = "current") -> int | None:
    """Number of frames of a video of the table; None for any other."""
    row = catalogue().get(video)
    if row is None:
        return None
    return FRAMES_BEFORE_2023_05.get(video, row.frames) if release == "pre_2023_05" else row.frames


def _without_seed(name: str) -> tuple[str, str]:
    match = re.fullmatch(r"(.+?)(_s(?:0|[1-9]\d*))?", name)
    return (match[1], match[2] or "") if match else (name, "")
