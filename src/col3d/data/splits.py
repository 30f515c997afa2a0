"""The videos of C3VD, the labels of the Col3D-MTL paper, and splits as lists of videos or frame ranges."""

import csv
import fnmatch
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

from col3d.checks import DataError, nearest_name

SPLITS = ("train", "val", "test")
PRINTED_LABELS = {"t3v1": "t4v1"}
"""Misprints of the paper's table and what they stand for."""
FRAMES_BEFORE_2023_05 = {"sigmoid_t1_a": 800}
"""Videos that the earlier release holds with another number of frames."""


@dataclass(frozen=True)
class Video:
    """One row of the table of videos."""

    name: str
    frames: int
    label: str
    split: str
    segment: str
    texture: str


@dataclass(frozen=True)
class Selection:
    """A whole video, or its frames from `first` to `last`, both included."""

    video: str
    first: int | None = None
    last: int | None = None

    def __str__(self) -> str:
        return self.video if self.first is None else f"{self.video}:{self.first}-{self.last}"

    def __contains__(self, frame: int) -> bool:
        return (self.first is None or frame >= self.first) and (self.last is None or frame <= self.last)


@cache
def video_table() -> Mapping[str, Video]:
    """The 22 registered videos of C3VD by name."""
    text = files("col3d.data").joinpath("videos.csv").read_text(encoding="utf-8")
    rows = csv.DictReader(text.splitlines())
    videos = (
        Video(r["video"], int(r["frames"]), r["col3d_label"], r["paper_split"], r["segment"], r["texture"])
        for r in rows
    )
    return {video.name: video for video in videos}


def paper_split() -> dict[str, list[str]]:
    """The split of the paper by names of videos; cecum_t1_b is in none."""
    return {split: [v.name for v in video_table().values() if v.split == split] for split in SPLITS}


def leave_out(kind: str, value: str) -> dict[str, list[str]]:
    """A split that tests on every video of one segment or texture, and neither trains nor validates on any.

    Validated on the paper's validation videos that are left, trained on all others, cecum_t1_b among them.

    Args:
        kind: "segment" or "texture".
        value: which, such as "cecum" or "3".

    Raises:
        DataError: no video is of it.
    """
    test = [v.name for v in video_table().values() if getattr(v, kind) == value]
    if not test:
        raise DataError(f"split: no video of C3VD has the {kind} {value!r}")
    rest = [v for v in video_table().values() if v.name not in test]
    return {
        "train": [v.name for v in rest if v.split != "val"],
        "val": [v.name for v in rest if v.split == "val"],
        "test": test,
    }


def seeded_name(video: str, seed: int) -> tuple[str, int]:
    """Split `cecum_t1_a_s7`, a phantom's video of a seed of its own, into name and seed; else as given."""
    match = re.fullmatch(r"(.+)_s(0|[1-9]\d*)", video)
    return (match[1], int(match[2])) if match and match[1] in video_table() else (video, seed)


def seeded_videos(first: int, last: int) -> list[str]:
    """Names of a phantom's videos number `first` to `last`: all of C3VD's of seed 0, then of seed 1, ..."""
    names = list(video_table())
    return [f"{names[k % len(names)]}_s{k // len(names)}" for k in range(first, last + 1)]


def describe(video: str) -> tuple[str, str]:
    """Segment and texture of a video, empty where the table does not list it."""
    row = video_table().get(seeded_name(video, 0)[0])
    return (row.segment, row.texture) if row else ("", "")


def parse_selection(entry: str, present: Sequence[str] = ()) -> Selection:
    """Read an entry of a split.

    Args:
        entry: a video's name (`cecum_t1_a`), its label in the paper (`c1v1`), or either with the frames
            to take, both ends included (`cecum_t1_a:0-120`).
        present: names of folders at hand; a video that the table does not list must be among them.

    Raises:
        DataError: unknown video or malformed range, with the nearest name.
    """
    match = re.fullmatch(r"([^:]+)(?::(\d+)-(\d+))?", entry)
    if match is None:
        raise DataError(
            f"split entry {entry!r}: expected VIDEO or VIDEO:FIRST-LAST, such as cecum_t1_a:0-120"
        )
    name, first, last = match.groups()
    names = {video.label: video.name for video in video_table().values() if video.label}
    name = names.get(PRINTED_LABELS.get(name, name), name)
    if seeded_name(name, 0)[0] not in video_table() and name not in present:
        known = [*video_table(), *names, *present]
        raise DataError(
            f"video {name!r} is neither one of C3VD nor a video of data.root{nearest_name(name, known)}"
        )
    if first is not None and int(first) > int(last):
        raise DataError(f"split entry {entry!r}: the first frame comes after the last")
    return Selection(name, None if first is None else int(first), None if last is None else int(last))


def selection_of_any_video(entry: str) -> Selection:
    """Read an entry of a split as `parse_selection` does, whatever the name of its video.

    For where no folders are at hand, or those that are say later whether the video is among them.
    """
    return parse_selection(entry, [entry.partition(":")[0]])


def expand(entries: Sequence[str], present: Sequence[str]) -> list[str]:
    """Entries of a split with wildcards (`c1_*`) replaced by the videos at hand that they match, in order.

    Raises:
        DataError: one matches nothing.
    """
    found: list[str] = []
    for entry in entries:
        if not set("*?") & set(entry):
            found.append(entry)
            continue
        matching = fnmatch.filter(sorted(present), entry)
        if not matching:
            raise DataError(f"split entry {entry!r}: no video of data.root matches")
        found += [video for video in matching if video not in found]
    return found


def check_counts(frames: Mapping[str, int], release: str) -> None:
    """Hold the number of frames of whole videos against the table.

    Raises:
        DataError: names each video whose count differs.
    """
    for name, count in frames.items():
        expected = video_table()[name].frames
        if release == "pre_2023_05":
            expected = FRAMES_BEFORE_2023_05.get(name, expected)
        if count != expected:
            raise DataError(
                f"video {name} has {count} frames, C3VD's {release} release has {expected}: copy it again, "
                "or set data.allow_missing=true to use what is there"
            )
