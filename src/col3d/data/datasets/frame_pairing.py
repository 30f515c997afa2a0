"""Pair images and depth of a folder by number, by shifted number, or by time stamp."""

from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

from col3d.data.datasets.frame_files import Twice, by_number
from col3d.errors import DataError

SECONDS_DIGITS = 10
"""Digits of a time stamp in whole seconds since 1970; longer ones count milli-, micro- or nanoseconds."""
FIRST_NUMBERS = {0, 1}
"""First numbers of two numberings that differ by one."""
LABEL = r"\d+(?:\.\d+)?"
"""Pattern of the label of a file: a number or a time stamp."""
IN_ORDER = "{}: frames are numbered in the order of their time stamps"
Labels = Mapping[str, Path]


@dataclass(frozen=True)
class Paired:
    """Files by the number of their frame.

    Attributes:
        images: image of each frame.
        depths: depth of each frame.
        note: how they were paired, where not simply by number; else empty.
    """

    images: dict[int, Path]
    depths: dict[int, Path]
    note: str = ""


def pair(
    folder: Path, images: Labels, depths: Labels, offset: int | None, tolerance: float, twice: Twice
) -> Paired:
    """Pair images with depth.

    Args:
        folder: folder of the video, for messages.
        images: images by number or time stamp, as written.
        depths: depth files likewise.
        offset: number of a depth minus that of its image; None for 0, or where one begins at 0, one at 1.
        tolerance: seconds by which two time stamps of a frame may differ.
        twice: called for a second file of one number.

    Raises:
        DataError: the numbers begin at different places, or no time stamps belong together.
    """
    if any(_is_stamp(label) for label in (*images, *depths)) and images.keys() != depths.keys():
        return _by_stamp(folder, images, depths, tolerance)
    if any("." in label for label in images):
        order = {label: number for number, label in enumerate(sorted(images, key=Decimal))}
        numbers = [{order[label]: path for label, path in files.items()} for files in (images, depths)]
        return Paired(numbers[0], numbers[1], IN_ORDER.format(folder))
    seen, known = (
        by_number(folder, sorted((path, label) for label, path in files.items()), twice)
        for files in (images, depths)
    )
    shift = offset if offset is not None else _shift(folder, seen, known)
    shifted = {number - shift: path for number, path in known.items()}
    if not shift or offset is not None:
        return Paired(seen, shifted)
    first = f"depth {min(known)} is of image {min(seen)}"
    return Paired(seen, shifted, f"{folder}: {first} (data.layout.depth_offset={shift})")


def _is_stamp(label: str) -> bool:
    return "." in label or len(label.lstrip("0")) >= SECONDS_DIGITS


def _shift(folder: Path, images: Mapping[int, Path], depths: Mapping[int, Path]) -> int:
    """Number of a depth minus that of its image, where both are numbered without a gap alike."""
    if not images or len(images) != len(depths) or images.keys() == depths.keys():
        return 0
    shift = min(depths) - min(images)
    if {number + shift for number in images} != depths.keys():
        return 0
    if {min(images), min(depths)} != FIRST_NUMBERS:
        raise DataError(
            f"{folder}: images are numbered from {min(images)}, depth from {min(depths)}; "
            f"data.layout.depth_offset={shift} pairs them in order, data.layout.depth_offset=0 by number"
        )
    return shift


def _by_stamp(folder: Path, images: Labels, depths: Labels, tolerance: float) -> Paired:
    """Pair the nearest first, each file at most once; frames are numbered in the order of images."""
    (seen, known), scale = (sorted(files, key=Decimal) for files in (images, depths)), _per_second(images)
    times = [Decimal(label) for label in known]
    near: list[tuple[Decimal, int, int]] = []
    for number, label in enumerate(seen):
        place, time = bisect_left(times, Decimal(label)), Decimal(label)
        near += [(abs(times[k] - time), number, k) for k in (place - 1, place) if 0 <= k < len(times)]
    chosen: dict[int, int] = {}
    taken: set[int] = set()
    for apart, number, k in sorted(near):
        if apart <= Decimal(str(tolerance)) * scale and number not in chosen and k not in taken:
            chosen[number] = k
            taken.add(k)
    if near and not chosen:
        raise DataError(
            f"{folder}: no depth is within {tolerance:g} s of an image, the nearest is "
            f"{min(near)[0] / scale:.3f} s away; take a larger data.layout.stamp_tolerance"
        )
    left = len(seen) - len(chosen)
    note = IN_ORDER.format(folder)
    if left:
        note += f"; {left} of {len(seen)} images have no depth within {tolerance:g} s and are left out"
    return Paired(
        {number: images[seen[number]] for number in chosen},
        {number: depths[known[k]] for number, k in chosen.items()},
        note,
    )


def _per_second(labels: Sequence[str] | Labels) -> int:
    whole = max((len(label.partition(".")[0]) for label in labels), default=SECONDS_DIGITS)
    return 10 ** max(0, whole - SECONDS_DIGITS)
