"""Index of a data set: its videos, their folders, and the files of each frame."""

from abc import ABC
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import ClassVar

from col3d.data.datasets.frame_files import Frame, Kind, Twice, choose_frames, refuse_twice
from col3d.data.files.image_files import check_header
from col3d.data.splits import parse_selection
from col3d.errors import DataError
from col3d.geometry import Camera


class DatasetIndex(ABC):
    """Finds videos and the files of their frames, without decoding them.

    Attributes:
        root: folder of the folders of videos.
        camera: lens and size of the stored frames.
        normals: `stored` where files of normals are needed.
        frames: frames that were chosen already; none is chosen twice.
        notes: by the folder of a video, how its files were paired, where not simply by number.
    """

    kinds: Mapping[str, Kind]
    """Kinds of files: `color`, `depth`, and of `normals`, `occlusion` and `flow` those that exist."""
    example: ClassVar[str]
    """Names of two files that a frame needs, for messages."""
    root: Path
    camera: Camera
    normals: str
    frames: list[Frame]
    notes: dict[Path, str]

    @classmethod
    def video_folders(cls, root: Path) -> dict[str, Path]:
        """The folder of each video by its name: all folders in the root, but for hidden ones.

        Raises:
            DataError: there is no such root.
        """
        check_root(root)
        folders = sorted(path for path in root.iterdir() if path.is_dir() and not path.name.startswith("."))
        return named(folders)

    @cached_property
    def folders(self) -> dict[str, Path]:
        """The folder of each video by its name, as found at the first use.

        Raises:
            DataError: there is no such root.
        """
        return self.video_folders(self.root)

    def needed(self, video: str = "") -> list[str]:
        """Kinds of files that are read; for a video without truth, those that it has."""
        return ["color", "depth", *(["normals"] if self.normals == "stored" else [])]

    def refusal(self, video: str) -> str:
        """Reason why a video cannot be scored or trained on, whatever its files are; empty for any other."""
        return ""

    def unreachable(self, video: str) -> str:
        """Reason why an existing video is not found; empty for any other."""
        return ""

    def without_frames(self) -> str:
        """Message for a data set none of whose folders has any frame."""
        reasons = (self.why_none(folder) for folder in self.folders.values())
        reason = next((f"; {why}" for why in reasons if why), "")
        return f"no frames {self.example} in any folder{reason}"

    def why_none(self, folder: Path) -> str:
        """Reason why a folder has no images, where other files in it show it; else empty."""
        return ""

    def renamed(self) -> dict[str, str]:
        """Videos in folders of other names: name here -> name of the folder."""
        return {video: folder.name for video, folder in self.folders.items() if video != folder.name}

    def find(self, entry: str) -> list[Frame]:
        """The frames of an entry of a split, with the files that are needed.

        Raises:
            DataError: there is no such video, it cannot be used, a frame lacks a file, or was chosen before.
        """
        selection = parse_selection(entry, list(self.folders))
        if reason := self.refusal(selection.video):
            raise DataError(f"split entry {entry!r}: {reason}")
        folder = self.folders.get(selection.video)
        if folder is None:
            raise DataError(
                f"{self.root / selection.video}: no such video; copy it there or leave it out of data.split"
            )
        needed = self.needed(selection.video)
        files = self.files(folder, needed)
        frames = choose_frames(folder, selection, self.kinds, files, self.example)
        if twice := {frame.number for frame in frames} & self._numbers(selection.video):
            raise DataError(
                f"split entry {entry!r}: frame {min(twice)} of {selection.video} is chosen already"
            )
        return frames

    def files(
        self, folder: Path, kinds: Sequence[str], twice: Twice = refuse_twice
    ) -> dict[str, dict[int, Path]]:
        """Files of a video by kind and frame number.

        Args:
            folder: folder of the video.
            kinds: kinds of files to find.
            twice: called for a second file of one number.

        Raises:
            DataError: two files have the same number, unless `twice` takes it.
        """
        return {kind: self.kinds[kind].find(folder, twice) for kind in kinds}

    def check(self, frame: Frame) -> None:
        """Refuse a frame one of whose files is not the complete image that it should be.

        Raises:
            DataError: names the file.
        """
        for kind, path in frame.files.items():
            self.check_file(kind, path)

    def check_file(self, kind: str, path: Path) -> None:
        """Refuse a file of a kind by its header.

        Raises:
            DataError: names the file, the rule and what was found.
        """
        check_header(path, self.camera.size_hw, self.kinds[kind].channels, self.kinds[kind].bits)

    def _numbers(self, video: str) -> set[int]:
        return {frame.number for frame in self.frames if frame.video == video}


def named(folders: Iterable[Path]) -> dict[str, Path]:
    """Folders by their names.

    Raises:
        DataError: a name is not UTF-8, so that no file of results could hold it.
    """
    by_name = {folder.name: folder for folder in folders}
    for name in by_name:
        try:
            name.encode()
        except UnicodeEncodeError:
            raise DataError(f"{name!r}: the name of this folder is not UTF-8; rename it") from None
    return by_name


def check_root(root: Path) -> None:
    """Refuse a root that is no folder.

    Raises:
        DataError: says what it should be.
    """
    if not root.is_dir():
        raise DataError(f"data.root={root}: no such folder; it holds one folder for each video")
