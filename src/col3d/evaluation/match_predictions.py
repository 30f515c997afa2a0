"""Match the scored frames of a data set to files of predictions, which any program may have named."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from col3d.data.datasets.videos import described
from col3d.data.files.arrays import array_header
from col3d.errors import DataError
from col3d.evaluation.options import ReadingOptions

SUFFIXES = (".npy", ".npz", ".pfm", ".png", ".tif", ".tiff")
STACKS = (".npy", ".npz")
"""Endings of files that hold the frames of a whole video."""
LAST_NUMBER = re.compile(r"(.*?)(\d+)(\D*)")
DEPTH_WORDS, NORMAL_WORDS = ("depth", "disp"), ("normal",)
LISTED = 5


@dataclass(frozen=True)
class Place:
    """Where the prediction of a frame is: a file, or a frame of the array of a whole video."""

    path: Path
    index: int | None = None


@dataclass(frozen=True)
class Matched:
    """Predictions of a video.

    Attributes:
        places: by number of the frame.
        others: number of files, or frames of an array, that belong to no scored frame.
        how: where they are and how they were matched, for a table.
    """

    places: Mapping[int, Place]
    others: int
    how: str


def match(
    folder: Path, reading: ReadingOptions, videos: Mapping[str, Sequence[int]], kind: str
) -> dict[str, Matched]:
    """Match the scored frames of each video to files of a kind.

    Args:
        folder: folder of the files, or of a folder for each video.
        reading: how files are named and numbered.
        videos: numbers of the scored frames, by video.
        kind: "depth" or "normals".

    Raises:
        DataError: a frame has no prediction, or it is not clear which file it is.
    """
    name: str | None = getattr(reading, kind)
    matched = {}
    for video, numbers in videos.items():
        stack = _stack(folder, video) if name is None else None
        if stack is not None:
            matched[video] = _in_stack(stack, numbers, reading.order)
            continue
        place = _place(folder, video, len(videos))
        files = _found(place, kind) if name is None else _named(place, name, kind)
        in_order = reading.order == "position"
        matched[video] = (_in_order if in_order else _by_number)(place, files, numbers, kind)
    return matched


def _stack(folder: Path, video: str) -> Path | None:
    """The array of all frames of a video, if there is one."""
    paths = (folder / f"{name}{suffix}" for name in _names(video) for suffix in STACKS)
    return next((path for path in paths if path.is_file()), None)


def _place(folder: Path, video: str, videos: int) -> Path:
    """The folder of a video's files: its own, or the folder itself where one video alone is scored."""
    names = _names(video)
    place = next((folder / name for name in names if (folder / name).is_dir()), None)
    if place is None and videos > 1:
        raise DataError(
            f"predictions={folder}: no folder and no array of {video} in it; looked for "
            f"{', '.join(names)}, and {names[0]}.npy or .npz"
        )
    return place or folder


def _by_number(place: Path, files: Mapping[int, Path], numbers: Sequence[int], kind: str) -> Matched:
    missing = [number for number in numbers if number not in files]
    if missing:
        listed = ", ".join(map(str, missing[:LISTED])) + (", ..." if len(missing) > LISTED else "")
        if len(files) == len(numbers):
            listed += f"; as many files are numbered {min(files)} to {max(files)}: reading.order=position"
        raise DataError(f"{place}: {len(missing)} of {len(numbers)} frames have no {kind}: {listed}")
    others = len(files) - len(numbers)
    return Matched({n: Place(files[n]) for n in numbers}, others, f"{place.name}/, by number")


def _in_order(place: Path, files: Mapping[int, Path], numbers: Sequence[int], kind: str) -> Matched:
    if len(files) != len(numbers):
        raise DataError(
            f"{place}: {len(files)} files of {kind} for {len(numbers)} frames: reading.order=position takes "
            "as many"
        )
    pairs = zip(sorted(numbers), sorted(files), strict=True)
    return Matched({number: Place(files[k]) for number, k in pairs}, 0, f"{place.name}/, in order")


def _in_stack(path: Path, numbers: Sequence[int], order: str) -> Matched:
    """Frames of an array: those that are scored, or all of a video."""
    shape = array_header(path).shape
    if len(shape) not in (3, 4):
        raise DataError(f"{path}: expected the frames of a video, (n, h, w), got shape {shape}")
    count, last = shape[0], max(numbers)
    if count == len(numbers) and (order == "position" or count <= last):
        places = {number: Place(path, index) for index, number in enumerate(sorted(numbers))}
        return Matched(places, 0, f"{path.name}, in order")
    if count <= last:
        raise DataError(
            f"{path}: {count} frames, which are neither the {len(numbers)} that are scored nor a video up to "
            f"frame {last}"
        )
    places = {number: Place(path, number) for number in numbers}
    return Matched(places, count - len(numbers), f"{path.name}, by number")


def _names(video: str) -> list[str]:
    """Names that a video may go by: here, in its data set today, in the paper."""
    known = described(video)
    others = (known.released_as, known.label) if known is not None else ()
    return list(dict.fromkeys([video, *(name for name in others if name)]))


def _named(place: Path, name: str, kind: str) -> dict[int, Path]:
    """Files whose name is as given, {} for the number."""
    before, after = (re.escape(part) for part in name.split("{}"))
    pattern = re.compile(f"{before}(\\d+){after}")
    paths = sorted(path for path in place.rglob("*") if path.is_file())
    files = {
        int(match[1]): path
        for path in paths
        if (match := pattern.fullmatch(path.relative_to(place).as_posix()))
    }
    if not files:
        raise DataError(f"{place}: no file is called as reading.{kind}={name} says")
    return files


def _found(place: Path, kind: str) -> dict[int, Path]:
    """The one series of numbered files of a folder that may be of a kind."""
    series: dict[tuple[str, str, str], dict[int, Path]] = {}
    for path in sorted(place.iterdir()):
        if path.suffix.lower() in SUFFIXES and (match := LAST_NUMBER.fullmatch(path.stem)):
            key = match[1], match[3], path.suffix
            series.setdefault(key, {})[int(match[2])] = path
    words, others = (DEPTH_WORDS, NORMAL_WORDS) if kind == "depth" else (NORMAL_WORDS, DEPTH_WORDS)
    fitting = {key: files for key, files in series.items() if not _says(key, others)}
    if len(fitting) > 1:
        fitting = {key: files for key, files in fitting.items() if _says(key, words)}
    if len(fitting) != 1:
        listed = ", ".join(f"{before}{{}}{after}{suffix}" for before, after, suffix in list(series)[:LISTED])
        what = f"several kinds of files ({listed})" if series else f"no numbered {'/'.join(SUFFIXES)}"
        raise DataError(f"{place}: {what}; name those of {kind} by reading.{kind}=NAME_{{}}.npy")
    return next(iter(fitting.values()))


def _says(key: tuple[str, str, str], words: Sequence[str]) -> bool:
    return any(word in part.lower() for part in key[:2] for word in words)
