"""Frames of your own: images with depth in a unit that you describe, and a file for the camera."""

from collections.abc import Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Shaped
from torch import Tensor

from col3d.data.datasets.dataset_index import check_root, named
from col3d.data.datasets.frame_files import Frame, Kind, Twice, labelled, refuse_twice
from col3d.data.datasets.frame_pairing import LABEL, pair
from col3d.data.datasets.frame_set import Depth, FrameSet
from col3d.data.files.depth_files import check_depth_file, read_depth_file
from col3d.data.splits import selection_of_any_video
from col3d.errors import DataError
from col3d.geometry.camera_file import read_camera

DEEPEST = 3
"""Levels below the root at which a video may lie."""
SHORT = 2
"""Size in bytes up to which a float of 32 bits holds integers exactly."""


def too_deep(root: Path, video: str) -> str:
    """Reason why an existing folder of a video is not found: its depth; empty for any other."""
    levels = video.strip("/").count("/") + 1
    if levels <= DEEPEST or not (root / video).is_dir():
        return ""
    return (
        f"data.root={root}: {video} lies {levels} levels below it, and videos are looked for on {DEEPEST}; "
        "name a folder nearer to them"
    )


class FolderFrames(FrameSet):
    """Frames of one folder for each video, in standard units; see `FrameSet`.

    Args:
        root: folder of the folders of videos; it holds the camera's file.
        videos: names, or frame ranges such as `clip_1:0-120`.
        image: path of an image in the folder of its video, {} for its number, such as `{}.png`.
        depth: path of its depth likewise; see `col3d.data.files.depth_files` for what is read. What is 0,
            negative, infinite or NaN is unknown.
        depth_unit: millimetres that 1 in a depth file stands for.
        max_depth: millimetres; what lies beyond does not count.
        camera_file: in the root; `docs/cameras.md` lists what is read. What it does not see does not count.
        normals: `derived` from the depth, or `none`.
        depth_channel: channel that is depth, counted from 0, in depth files whose channels differ.
        depth_offset: number of a depth minus that of its image; None for 0, or for 1 and -1 where files tell.
        stamp_tolerance: seconds by which the time stamps of an image and its depth may differ.
    """

    example = "as data.layout describes them"

    def __init__(
        self,
        root: str | Path,
        videos: Sequence[str],
        image: str,
        depth: str,
        depth_unit: float,
        max_depth: float,
        camera_file: str = "camera.json",
        normals: str = "derived",
        depth_channel: int | None = None,
        depth_offset: int | None = None,
        stamp_tolerance: float = 0.02,
    ) -> None:
        for option, name in (("image", image), ("depth", depth)):
            if name.count("{}") != 1 or "{}" not in Path(name).name:
                raise DataError(f"data.layout.{option}: expected {{}} once, in the file's name; got {name!r}")
        self.kinds = {"color": Kind(image, None, None), "depth": Kind(depth, 1, None)}
        self.depth_unit, self.max_depth, self.depth_channel = depth_unit, max_depth, depth_channel
        self.depth_offset, self.stamp_tolerance = depth_offset, stamp_tolerance
        self.decoded_in: set[Path] = set()
        check_root(Path(root))
        super().__init__(root, videos, read_camera(Path(root) / camera_file), normals)
        seen = self.camera.sees()
        self.view = None if bool(seen.all()) else seen

    @cached_property
    def folders(self) -> dict[str, Path]:
        """The folder of each video by its path below the root, at most three levels deep."""
        check_root(self.root)
        return {path.relative_to(self.root).as_posix(): path for path in self._videos(self.root, DEEPEST)}

    def find(self, entry: str) -> list[Frame]:
        """The frames of an entry of a split.

        Raises:
            DataError: as for any data set, and where the folder's images have other names or lie elsewhere.
        """
        video = selection_of_any_video(entry, list(self.folders)).video
        if (reason := too_deep(self.root, video)) and video not in self.folders:
            raise DataError(reason)
        folder = self.folders.get(video)
        if folder is not None and not self._has_images(folder) and (reason := self.why_none(folder)):
            raise DataError(f"{folder}: {reason}")
        return super().find(entry)

    def unreachable(self, video: str) -> str:
        """Reason why an existing video is not found: it lies too deep."""
        return too_deep(self.root, video)

    def why_none(self, folder: Path) -> str:
        """Reason why a folder has no images, where other files or folders show it; else empty."""
        name = Path(self.kinds["color"].name)
        place = folder / name.parent
        others = sorted(path.name for path in place.glob(f"*{name.suffix}")) if place.is_dir() else []
        if others:
            return (
                f"none of its {len(others)} files *{name.suffix} is called as data.layout.image={name} says, "
                f"with a number or time stamp in place of {{}}; there is {others[0]!r}"
            )
        for path in sorted(folder.rglob(f"*{name.suffix}")):
            if self._has_images(Path(str(path.parent).removesuffix(f"/{name.parent}"))):
                return (
                    f"its images lie deeper, such as {path}; videos lie at most {DEEPEST} levels below "
                    "data.root: name a folder nearer to them"
                )
        return ""

    def renamed(self) -> dict[str, str]:
        """Nothing: a video is named by the path of its folder."""
        return {}

    def _videos(self, folder: Path, levels: int) -> Iterator[Path]:
        """Folders that hold images; of branches without any image, the topmost folder."""
        folders = (path for path in folder.iterdir() if path.is_dir() and not path.name.startswith("."))
        for path in named(sorted(folders)).values():
            inside = [] if self._has_images(path) or levels == 1 else [*self._videos(path, levels - 1)]
            deeper = [video for video in inside if self._has_images(video)]
            yield from deeper or [path]

    def _has_images(self, folder: Path) -> bool:
        return next(labelled(folder, self.kinds["color"].name, LABEL), None) is not None

    def files(
        self, folder: Path, kinds: Sequence[str], twice: Twice = refuse_twice
    ) -> dict[str, dict[int, Path]]:
        """Files of a video by kind and frame number; see `col3d.data.datasets.frame_pairing`.

        Raises:
            DataError: they cannot be paired.
        """
        images, depths = (
            {label: path for path, label in labelled(folder, self.kinds[kind].name, LABEL)}
            for kind in ("color", "depth")
        )
        paired = pair(folder, images, depths, self.depth_offset, self.stamp_tolerance, twice)
        if paired.note:
            self.notes[folder] = paired.note
        by_kind = {"color": paired.images, "depth": paired.depths}
        return {kind: by_kind[kind] for kind in kinds}

    def decoding(self) -> dict[str, Any]:
        """Options that decide the meaning of codes in files."""
        names = {name: kind.name for name, kind in self.kinds.items()}
        channel = {} if self.depth_channel is None else {"depth_channel": self.depth_channel}
        return {**names, "depth_unit": self.depth_unit, **channel}

    def check_file(self, kind: str, path: Path) -> None:
        """Refuse a file by its header; the first depth file of several channels in a folder is also read.

        Raises:
            DataError: names the file, the rule and what was found.
        """
        if kind != "depth":
            return super().check_file(kind, path)
        channels = check_depth_file(path, self.camera.size_hw, self.depth_channel)
        if channels > 1 and self.depth_channel is None and path.parent not in self.decoded_in:
            self.depth_codes(path)
            self.decoded_in.add(path.parent)
        return None

    def depth_codes(self, path: Path) -> Shaped[np.ndarray, "h w"]:
        """Depth as it is stored in a file.

        Raises:
            DataError: the file is not what it should be.
        """
        return read_depth_file(path, self.camera.size_hw, self.depth_channel)

    def field_of_view(self) -> Bool[Tensor, "1 h w"] | None:
        """Pixels with a ray less than 90 degrees from the axis; None where all have one."""
        return self.view

    def decoded_depth(self, codes: Shaped[np.ndarray, "h w"]) -> Depth:
        """Decode depth, of all pixels or of some."""
        wide = codes.dtype.itemsize > SHORT and codes.dtype != np.float32
        with np.errstate(over="ignore", invalid="ignore"):  # values that are not finite do not count
            exact = codes.astype(np.float64) if wide else codes.astype(np.float32)
            mm = (exact * np.float32(self.depth_unit)).astype(np.float32, copy=False)
        return Depth(mm, np.isfinite(mm) & (mm > 0) & (mm <= self.max_depth))
