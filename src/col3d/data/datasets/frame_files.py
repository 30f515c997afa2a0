"""Find the files of a video by kind and number, and combine them into frames."""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from col3d.data.datasets.videos import frames_of
from col3d.data.splits import Selection, check_end
from col3d.errors import DataError

Twice = Callable[[int, str], None]
"""Called with a number that two files have, and a description of the fault."""


def refuse_twice(number: int, fault: str) -> None:
    """Refuse a frame that exists twice.

    Raises:
        DataError: describes the fault.
    """
    raise DataError(fault)


@dataclass(frozen=True)
class Kind:
    """One kind of file of a frame.

    Attributes:
        name: path in the video's folder, with {} for the number of the frame.
        channels: number of channels; None for any number.
        bits: bits of each channel; None for any number.
        others: alternative paths, in other layouts.
    """

    name: str
    channels: int | None
    bits: int | None
    others: tuple[str, ...] = ()

    def named(self, number: int | str, folder: Path | None = None) -> str:
        """The path for a frame, its number padded to four digits; in the layout of a folder, if given."""
        matching = (name for name in self.others if folder is not None and (folder / name).parent.is_dir())
        number = number if isinstance(number, str) else f"{number:04d}"
        return next(matching, self.name).format(number)

    def at(self, folder: Path, number: int) -> Path | None:
        """The file of a frame by its padded number, in any layout; None where it does not exist."""
        paths = (folder / name.format(f"{number:04d}") for name in (self.name, *self.others))
        return next((path for path in paths if path.is_file()), None)

    def find(self, folder: Path, twice: Twice = refuse_twice) -> dict[int, Path]:
        """Find files by frame number, in any layout, the number in the name padded or not.

        Args:
            folder: folder of the video.
            twice: called with a number that two files have and the fault; the first file is kept.

        Raises:
            DataError: two files have the same number, unless `twice` takes it.
        """
        names = (self.name, *self.others)
        return by_number(folder, (file for name in names for file in sorted(labelled(folder, name))), twice)


def labelled(folder: Path, name: str, label: str = r"\d+") -> Iterator[tuple[Path, str]]:
    """Find files of a name with {} for a label; yields each with its label as it is written.

    Args:
        folder: folder of the video.
        name: path in the folder.
        label: regular expression of the label.
    """
    place = folder / Path(name).parent
    before, after = (re.escape(part) for part in Path(name).name.split("{}"))
    pattern = re.compile(rf"{before}({label}){after}")
    for path in place.iterdir() if place.is_dir() else ():
        if match := pattern.fullmatch(path.name):
            yield path, match.group(1)


def by_number(folder: Path, files: Iterable[tuple[Path, str]], twice: Twice) -> dict[int, Path]:
    """Files by number, the first of each number; `twice` is called for the others."""
    files_by_number: dict[int, Path] = {}
    for path, label in files:
        first = files_by_number.setdefault(int(label), path)
        if first != path:
            named = first.relative_to(folder).as_posix()
            twice(int(label), f"{path}: the same frame as {named}; keep one of them")
    return files_by_number


@dataclass(frozen=True)
class Frame:
    """Paths of the files of one frame, by kind."""

    video: str
    number: int
    files: Mapping[str, Path] = field(hash=False)


def choose_frames(
    folder: Path,
    selection: Selection,
    kinds: Mapping[str, Kind],
    files: Mapping[str, Mapping[int, Path]],
    example: str,
) -> list[Frame]:
    """Frames of a video by number, each with its files of all kinds that were searched for.

    Args:
        folder: folder of the video.
        selection: frames to choose.
        kinds: kinds of files, for messages.
        files: files by kind and number, with `color`.
        example: two files that a frame needs.

    Raises:
        DataError: there is no frame, a frame lacks a file, or the range goes beyond the end of the video.
    """
    numbers = files["color"].keys() | files.get("depth", {}).keys()
    if numbers:
        check_end(selection, max(*numbers, (frames_of(selection.video) or 0) - 1))
    chosen = sorted(number for number in numbers if number in selection)
    if not chosen:
        raise DataError(f"{folder}: no frames {example} for {selection} in it")
    for kind in files:
        for number in chosen:
            if number not in files[kind]:
                hint = "; data.normals=derived computes them from the depth" if kind == "normals" else ""
                name = kinds[kind].named(number, folder)
                raise DataError(f"{folder}: frame {number} has no {name}{hint}")
    return [Frame(selection.video, n, {kind: files[kind][n] for kind in files}) for n in chosen]
