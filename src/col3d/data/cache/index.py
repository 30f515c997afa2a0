"""Index of a stored video: recipe, frames, sources and arrays, with checks that they still match."""

import json
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from col3d.data.cache.sources import crc32_of, state_of
from col3d.data.datasets.frame_files import Frame
from col3d.errors import DataError
from col3d.geometry import Camera
from col3d.geometry.camera_file import camera_from_plain, plain_from_camera

SCHEMA = 1
"""Version of the format, raised whenever equal sources give other codes or files than before."""
DENSE_RULE = (
    "image: bilinear, antialiased, in 8 bits; depth and normals: bilinear between the four pixels around; "
    "known where all four are"
)
DERIVED_RULE = DENSE_RULE + ", depth where normals are not known too"
SPARSE_RULE = DERIVED_RULE + "; else of the nearest known pixel inside"
INDEX = "index.json"


@dataclass(frozen=True)
class Recipe:
    """Settings that a store is made by; its videos fit a training that needs the same settings.

    Attributes:
        data: name of the data set.
        size_hw: height and width of the frames.
        normals: stored, derived or none.
        max_depth: depth in mm of the highest code.
        camera: the camera at that size.
        decoding: see `FrameSet.decoding`.
        dense_truth: see `FrameSet`.
    """

    data: str
    size_hw: tuple[int, int]
    normals: str
    max_depth: float
    camera: Camera
    decoding: Mapping[str, Any] = field(default_factory=dict)
    dense_truth: bool = True

    @property
    def resize_rule(self) -> str:
        """Description of how files become frames of the size."""
        if not self.dense_truth:
            return SPARSE_RULE
        return DERIVED_RULE if self.normals == "derived" else DENSE_RULE

    def plain(self) -> dict[str, Any]:
        """The recipe as values for JSON."""
        return {
            "schema": SCHEMA,
            "resize": self.resize_rule,
            "data": self.data,
            "size": list(self.size_hw),
            "normals": self.normals,
            "max_depth": self.max_depth,
            "camera": plain_from_camera(self.camera),
            "decoding": dict(self.decoding),
        }


@dataclass(frozen=True)
class Shard:
    """One array on disk.

    Attributes:
        shape: n frames first.
        dtype: numpy's text of the type.
        offset: bytes before the data: the header.
        bytes: size of the whole file.
        header_crc32: CRC-32 of the header.
        crc32: CRC-32 of the whole file.
    """

    shape: tuple[int, ...]
    dtype: str
    offset: int
    bytes: int
    header_crc32: int
    crc32: int

    def check(self, path: Path) -> None:
        """Refuse a file that is not the complete array.

        Raises:
            DataError: names the file.
        """
        try:
            size = path.stat().st_size
            with path.open("rb") as file:
                header = zlib.crc32(file.read(self.offset))
        except OSError as error:
            raise DataError(f"{path}: a store's array is missing ({error.strerror}){AGAIN}") from None
        if size != self.bytes:
            raise DataError(f"{path}: a store's array has {size} bytes instead of {self.bytes}{AGAIN}")
        if header != self.header_crc32:
            raise DataError(f"{path}: a store's array does not begin as it was written{AGAIN}")


AGAIN = "; run col3d prepare again"


@dataclass(frozen=True)
class StoredVideo:
    """The index of one video.

    Attributes:
        folder: folder of the video.
        recipe: values for JSON; see `Recipe.plain`.
        release: release of the data set that the source follows; empty where there is none.
        frames: numbers, in the order of the arrays.
        sources: path below the data set's root -> bytes and time of change in ns.
        shards: arrays by name.
    """

    folder: Path
    recipe: dict[str, Any]
    video: str
    release: str
    frames: tuple[int, ...]
    sources: dict[str, tuple[int, int]]
    shards: dict[str, Shard]

    @property
    def camera(self) -> Camera:
        """Camera of the stored frames."""
        return camera_from_plain(self.recipe["camera"])

    def write(self) -> None:
        """Write `index.json`."""
        content = {**self.recipe, "video": self.video, "release": self.release, "frames": list(self.frames)}
        content["shards"] = {name: asdict(shard) for name, shard in self.shards.items()}
        content["sources"] = {name: list(state) for name, state in self.sources.items()}
        (self.folder / INDEX).write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")

    def check(self) -> None:
        """Refuse arrays that are not complete.

        Raises:
            DataError: names the file.
        """
        for name, shard in self.shards.items():
            shard.check(self.folder / f"{name}.npy")

    def damaged(self) -> list[Path]:
        """Paths of arrays whose content differs from what was written; every byte is read."""
        paths = {self.folder / f"{name}.npy": shard for name, shard in self.shards.items()}
        return [path for path, shard in paths.items() if crc32_of(path) != shard.crc32]

    def differs(self, recipe: Recipe) -> str:
        """Fields that differ from the requested recipe, as text; empty if none does."""
        wanted = recipe.plain()
        names = [name for name in wanted if self.recipe.get(name) != wanted[name]]
        if "normals" in names:  # the rule of resizing follows from them
            names = [name for name in names if name != "resize"]
        return ", ".join(self._difference(name, wanted[name]) for name in names)

    def _difference(self, name: str, wanted: Any) -> str:
        stored = self.recipe.get(name)
        if name == "camera" and isinstance(stored, dict):
            fields = [field for field in wanted if stored.get(field) != wanted[field]]
            return f"another camera, of another {' and '.join(fields)}"
        return f"another {name}" if name == "resize" else f"{name} is {stored}, not {wanted}"

    def stale(self, root: Path, frames: Sequence[Frame]) -> str:
        """The first source file that has changed since, as text; empty if none has.

        Args:
            root: root of the data set.
            frames: requested frames of the video, as they are on disk now.
        """
        numbers = set(self.frames)
        for frame in frames:
            if frame.number not in numbers:
                return f"frame {frame.number} of {self.video} has come since"
            for path in frame.files.values():
                name = path.relative_to(root).as_posix()
                if self.sources.get(name) != state_of(path):
                    return f"{path} has changed since"
        return ""


def folder_of(store: Path, video: str) -> Path:
    """Folder of a video in a store; folders in its name make no folders in the store."""
    return store / video.replace("/", "__")


def videos_in(store: Path) -> list[str]:
    """Names of the videos in a store."""
    stored = (read_video(path) for path in store.iterdir() if path.is_dir())
    return sorted(video.video for video in stored if video is not None)


def read_video(folder: Path) -> StoredVideo | None:
    """Read the index in a folder; None where there is none that can be read."""
    try:
        content = json.loads((folder / INDEX).read_text(encoding="utf-8"))
        shards = content.pop("shards")
        return StoredVideo(
            folder,
            video=content.pop("video"),
            release=content.pop("release"),
            frames=tuple(content.pop("frames")),
            sources={name: (state[0], state[1]) for name, state in content.pop("sources").items()},
            shards={name: Shard(**{**s, "shape": tuple(s["shape"])}) for name, s in shards.items()},
            recipe=content,
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
