"""Plan of a download: the videos to fetch, what exists of them, and the disk space for the rest."""

import shutil
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from col3d.data.datasets.videos import catalogue, other_names
from col3d.data.download import RemoteFile
from col3d.data.download.options import DownloadOptions
from col3d.data.splits import expand, selection_of_any_video
from col3d.errors import DataError, UserError
from col3d.io.atomic import PARTIAL
from col3d.io.ownership import Owned
from col3d.nearest_names import nearest_name
from col3d.registry import DATASETS

GROWTH = 3
"""Assumed size of a video relative to its archive, where the server does not tell."""
GB = 1e9


@dataclass(frozen=True)
class Part:
    """A video to fetch, and its paths.

    Attributes:
        video: name of the video here.
        file: the archive on the server.
        root: folder of the videos.
    """

    video: str
    file: RemoteFile
    root: Path

    @property
    def archive(self) -> Path:
        """Path of the zip archive."""
        return self.root / self.file.name

    @property
    def folder(self) -> Path:
        """Folder of the video, by the name in its data set."""
        return self.root / self.file.name.removesuffix(".zip")

    @property
    def unpacking(self) -> Path:
        """Folder in which it is unpacked, hidden from readers of the data set."""
        return self.root / f".{self.folder.name}{PARTIAL}"

    @property
    def names(self) -> tuple[str, str, str]:
        """Names of what is written into the root on the way."""
        return self.archive.name, self.archive.name + PARTIAL, self.unpacking.name

    @property
    def done(self) -> int:
        """Bytes of the archive that are on the disk."""
        partial = self.archive.with_name(self.archive.name + PARTIAL)
        existing = next((path for path in (self.archive, partial) if path.is_file()), None)
        return min(existing.stat().st_size, self.file.size) if existing else 0


def named_videos(options: DownloadOptions) -> list[str]:
    """Names here of the requested videos, each once.

    Raises:
        DataError: a name is unknown, or of the other data set.
    """
    names_in_data = [video.name for video in catalogue().values() if video.data == options.data.name]
    if options.videos == "all":
        return names_in_data
    split = options.data.split
    entries = [*split.train, *split.val, *split.test] if options.videos == "split" else options.videos
    if not entries:
        raise UserError("videos: data.split names none; give videos=all, or videos=[...] by their names")
    names = [selection_of_any_video(entry).video for entry in _expanded(entries, names_in_data)]
    for name in names:
        _check(name, options.data.name)
    return list(dict.fromkeys(names))


def _expanded(entries: Sequence[str], names_in_data: Sequence[str]) -> list[str]:
    try:
        return expand(entries, names_in_data)
    except DataError as error:
        raise DataError(str(error).replace("no video of data.root", "no video of the data set")) from None


def _check(name: str, data: str) -> None:
    row = catalogue().get(name)
    if row is None:
        known = [*catalogue(), *other_names()]
        raise DataError(f"videos: {name!r} is no video of {data}{nearest_name(name, known)}")
    if row.data != data:
        raise DataError(f"videos: {row.released_as} is a video of {row.data}; take data={row.data}")


def existing_folders(options: DownloadOptions) -> dict[str, Path]:
    """Folders of videos in the root that are not empty, by the names here.

    Raises:
        UserError: the root is a file.
        DataError: two folders are of one video.
    """
    root = Path(options.data.root)
    if root.exists() and not root.is_dir():
        raise UserError(f"data.root: {root} is a file; name a folder")
    kind: Any = DATASETS[options.data.name].build
    folders = kind.video_folders(root) if root.is_dir() else {}
    return {video: folder for video, folder in folders.items() if any(folder.iterdir())}


def check_places(parts: Iterable[Part], owned: Owned) -> None:
    """Refuse to overwrite foreign files; a foreign archive is read, and has to be complete.

    Raises:
        UserError: names the file.
    """
    for part in parts:
        archive, *others = part.names
        owned.check(others)
        foreign = part.archive.exists() and archive not in owned.names
        if foreign and (not part.archive.is_file() or part.archive.stat().st_size != part.file.size):
            raise UserError(
                f"data.root: {part.archive} is of no download of this program, and is not the "
                f"{part.file.size} bytes that the server lists; move it away"
            )
        if part.folder.exists() and not part.folder.is_dir():
            raise UserError(
                f"data.root: {part.folder} is a file where the folder of a video belongs; move it"
            )


def check_space(parts: Sequence[Part], sizes: Mapping[str, int | None], options: DownloadOptions) -> str:
    """Refuse where the disk has no room for archives and unpacked videos; returns a line on their size.

    Raises:
        UserError: says how much is needed and free.
    """
    left = sorted((part.file.size - part.done for part in parts), reverse=True)
    archives = sum(left) if options.keep else sum(left[: options.parallel])
    guessed = any(sizes[part.video] is None for part in parts)
    unpacked = sum(sizes[part.video] or GROWTH * part.file.size for part in parts)
    root = Path(options.data.root)
    place = next(path for path in (root.absolute(), *root.absolute().parents) if path.is_dir())
    free, needed = shutil.disk_usage(place).free, archives + unpacked
    about = " or so" if guessed else ""
    text = f"{sum(left) / GB:.2f} GB to fetch, {unpacked / GB:.2f} GB{about} unpacked"
    if needed > free:
        raise UserError(
            f"data.root: {text}; that takes {needed / GB:.2f} GB at a time, and {place} has "
            f"{free / GB:.2f} GB free; fetch fewer videos, or name another disk"
        )
    return f"{text}, {free / GB:.2f} GB free"
