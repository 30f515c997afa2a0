"""Splits as lists of videos or frame ranges."""

import fnmatch
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from col3d.data.datasets.videos import (
    canonical_name,
    catalogue,
    frames_of,
    other_names,
    seeded_name,
    video_table,
)
from col3d.errors import DataError
from col3d.nearest_names import nearest_name

SPLITS = ("train", "val", "test")


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


def paper_split() -> dict[str, list[str]]:
    """The split of the paper by names of videos; cecum_t1_b is in none."""
    return {split: [v.name for v in video_table().values() if v.split == split] for split in SPLITS}


def leave_out(kind: str, value: str) -> dict[str, list[str]]:
    """A split that tests on all videos of a segment or texture, and trains and validates on none of them.

    It validates on the paper's remaining validation videos, and trains on all others, including cecum_t1_b.

    Args:
        kind: "segment" or "texture".
        value: name of the segment or texture, such as "cecum" or "3".

    Raises:
        DataError: no video has it.
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


def parse_selection(entry: str, present: Sequence[str] = ()) -> Selection:
    """Read an entry of a split.

    Args:
        entry: a video's name (`cecum_t1_a`, today `c0_cecum_t1_v1`), its label in the paper (`c1v1`), or one
            of these with the frames to take, both ends included (`cecum_t1_a:0-120`).
        present: names of videos at hand; one that the table does not list must be among them, and one of them
            is meant where a name is also another name of a video of the table.

    Raises:
        DataError: unknown video or malformed range, with the nearest name.
    """
    selection = selection_of_any_video(entry, present)
    if seeded_name(selection.video, 0)[0] not in catalogue() and selection.video not in present:
        known = [*catalogue(), *other_names(), *present]
        raise DataError(
            f"video {selection.video!r} is neither one of C3VD nor a video of data.root"
            f"{nearest_name(selection.video, known)}"
        )
    return selection


def selection_of_any_video(entry: str, present: Sequence[str] = ()) -> Selection:
    """Read an entry of a split as `parse_selection` does, whatever the name of its video.

    Use it where a later step checks that the video exists.

    Raises:
        DataError: malformed range.
    """
    match = re.fullmatch(r"([^:]+)(?::(\d+)-(\d+))?", entry)
    if match is None:
        raise DataError(
            f"split entry {entry!r}: expected VIDEO or VIDEO:FIRST-LAST, such as cecum_t1_a:0-120"
        )
    given, first, last = match.groups()
    name = given if given in present else canonical_name(given)
    if first is None:
        return Selection(name)
    if int(first) > int(last):
        raise DataError(f"split entry {entry!r}: the first frame comes after the last")
    return Selection(name, int(first), int(last))


def expand(entries: Sequence[str], present: Sequence[str]) -> list[str]:
    """Replace wildcards (`c1_*`) in entries of a split by the existing videos that they match, in order.

    A wildcard never matches a video that is known to have no truth.

    Raises:
        DataError: a wildcard matches nothing.
    """
    expanded: list[str] = []
    scored = sorted(video for video in present if video not in catalogue() or catalogue()[video].has_truth)
    for entry in entries:
        if not set("*?") & set(entry):
            expanded.append(entry)
            continue
        matching = [video for video in scored if fnmatch.fnmatch(video, entry) or _released_as(video, entry)]
        if not matching:
            raise DataError(f"split entry {entry!r}: no video of data.root matches")
        expanded += [video for video in matching if video not in expanded]
    return expanded


def check_end(selection: Selection, last: int) -> None:
    """Refuse a range that goes beyond the end of its video.

    Args:
        selection: frames of a video.
        last: number of the video's last frame.

    Raises:
        DataError: names the range and the end.
    """
    if selection.last is not None and selection.last > last:
        raise DataError(f"split entry '{selection}': the last frame of {selection.video} is {last}")


def _released_as(video: str, pattern: str) -> bool:
    """Whether a pattern matches the name that a video has in its data set today."""
    row = catalogue().get(video)
    return row is not None and fnmatch.fnmatch(row.released_as, pattern)


def check_counts(entries: Sequence[str], counts: Mapping[str, int], release: str) -> None:
    """Compare the number of frames of videos with the table.

    Args:
        entries: entries of a split.
        counts: number of frames by video; those of videos that the table does not list are not checked.
        release: release that the files of these videos follow.

    Raises:
        DataError: names the first video whose count differs.
    """
    chosen = [selection_of_any_video(entry) for entry in entries]
    for video, count in counts.items():
        whole = frames_of(video, release)
        if whole is None:
            continue
        parts = [selection for selection in chosen if selection.video == video]
        expected = sum(any(number in selection for selection in parts) for number in range(whole))
        if count != expected:
            raise DataError(
                f"video {', '.join(map(str, parts))} has {count} frames, its data set's {release} release "
                f"has {expected}: copy it again, or set data.allow_missing=true to use what is there"
            )
