"""Files of a video by kind and number, and the frames that they make up."""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from col3d.data.datasets.videos import frames_of
from col3d.data.splits import Selection, check_end
from col3d.errors import DataError

Twice = Callable[[int, str], None]
"""Is told the number that a second file has too, and what is wrong."""


def refuse_twice(number: int, fault: str) -> None:
    """Takes no frame that is there twice.

    Raises:
        DataError: the fault.
    """
    raise DataError(fault)


@dataclass(frozen=True)
class Kind:
    """One kind of file of a frame.

    Attributes:
        name: path in the video's folder, with {} for the number of the frame.
        channels: of its pixels; None where any number will do.
        bits: of each channel; None likewise.
        others: paths by which it may go instead, in another layout.
    """

    name: str
    channels: int | None
    bits: int | None
    others: tuple[str, ...] = ()

    def named(self, number: int | str, folder: Path | None = None) -> str:
        """The path for a frame, its number padded to four digits; in the layout of a folder, if given."""
        there = (name for name in self.others if folder is not None and (folder / name).parent.is_dir())
        number = number if isinstance(number, str) else f"{number:04d}"
        return next(there, self.name).format(number)

    def at(self, folder: Path, number: int) -> Path | None:
        """The file of a frame by its padded number, in any layout; None where there is none."""
        paths = (folder / name.format(f"{number:04d}") for name in (self.name, *self.others))
        return next((path for path in paths if path.is_file()), None)

    def find(self, folder: Path, twice: Twice = refuse_twice) -> dict[int, Path]:
        """Files by frame number, in any layout, whether the number in their name is padded or not.

        Args:
            folder: of the video.
            twice: is told the number that a second file has too, and what is wrong; the first file stays.

        Raises:
            DataError: two files have the same number, unless `twice` takes it.
        """
        names = (self.name, *self.others)
        return by_number(folder, (file for name in names for file in sorted(labelled(folder, name))), twice)


def labelled(folder: Path, name: str, label: str = r"\d+") -> Iterator[tuple[Path, str]]:
    """Files of a name with {} for a label, each with its label as it is written.

    Args:
        folder: of the video.
        name: path in it.
        label: pattern of what stands for {}.
    """
    place = folder / Path(name).parent
    before, after = (re.escape(part) for part in Path(name).name.split("{}"))
    pattern = re.compile(rf"{before}({label}){after}")
    for path in place.iterdir() if place.is_dir() else ():
        if match := pattern.fullmatch(path.name):
            yield path, match.group(1)


def by_number(folder: Path, files: Iterable[tuple[Path, str]], twice: Twice) -> dict[int, Path]:
    """Files by the number that their label is, the first of each number; `twice` is told of others."""
    found: dict[int, Path] = {}
    for path, label in files:
        first = found.setdefault(int(label), path)
        if first != path:
            named = first.relative_to(folder).as_posix()
            twice(int(label), f"{path}: the same frame as {named}; keep one of them")
    return found


@dataclass(frozen=True)
class Frame:
    """Where the files of one frame lie, by kind."""

    video: str
    number: int
    files: Mapping[str, Path] = field(hash=False)


def choose_frames(
    folder: Path,
    selection: Selection,
    kinds: Mapping[str, Kind],
    found: Mapping[str, Mapping[int, Path]],
    example: str,
) -> list[Frame]:
    """Frames of a video by number, each with its files of all kinds that were looked for.

    Args:
        folder: of the video.
        selection: which frames.
        kinds: of files, for messages.
        found: by kind and number; `color` among them.
        example: two files that a frame needs.

    Raises:
        DataError: there is no frame, a frame lacks a file, or the range goes beyond the end of the video.
    """
    there = found["color"].keys() | found.get("depth", {}).keys()
    if there:
        check_end(selection, max(*there, (frames_of(selection.video) or 0) - 1))
    chosen = sorted(number for number in there if number in selection)
    if not chosen:
        raise DataError(f"{folder}: no frames {example} for {selection} in it")
    for kind in found:
        for number in chosen:
            if number not in found[kind]:
                hint = "; data.normals=derived computes them from the depth" if kind == "normals" else ""
                name = kinds[kind].named(number, folder)
                raise DataError(f"{folder}: frame {number} has no {name}{hint}")
    return [Frame(selection.video, n, {kind: found[kind][n] for kind in found}) for n in chosen]
