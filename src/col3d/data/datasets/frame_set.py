"""What all data sets share: finding the files of frames, and items decoded to standard units."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
from jaxtyping import Bool, Float32, Shaped
from torch import Tensor
from torch.utils.data import Dataset

from col3d.data.datasets.frame_files import Frame, Kind, Twice, choose_frames, refuse_twice
from col3d.data.files.image_files import check_header, read_colour, read_grey, read_rgb
from col3d.data.splits import parse_selection
from col3d.errors import DataError, check_known
from col3d.geometry import Camera, normals_from_depth

NORMALS = ("stored", "derived", "none")
Take = Callable[[np.ndarray], np.ndarray]
"""Chooses pixels of an array (h, w) or (h, w, c)."""


def everywhere(values: np.ndarray) -> np.ndarray:
    """Takes all pixels."""
    return values


@dataclass(frozen=True)
class Depth:
    """Depth of one frame.

    Attributes:
        mm: millimetres along the optical axis; of no meaning where it is not known.
        known: where its code counts, outside the field of view too.
    """

    mm: Float32[np.ndarray, "h w"]
    known: Bool[np.ndarray, "h w"]


class FrameSet(Dataset[dict[str, Any]], ABC):
    """Frames of chosen videos at full resolution, in standard units: the keys of a `Batch` less its axis b.

    Every file's header and length is checked when the set is built.

    Args:
        root: folder of the folders of videos.
        videos: names, labels of the paper, or frame ranges such as `cecum_t1_a:0-120`.
        camera: lens and size of the stored frames.
        normals: `stored` reads them, `derived` computes them from the depth, `none` leaves them out.

    Attributes:
        frames: of the chosen videos.
        notes: by the folder of a video, how its files were paired where their numbers alone did not say.

    Raises:
        DataError: names the file or video, the rule and what came.
        ValueError: unknown `normals`, or `stored` where the data set has none.
    """

    kinds: Mapping[str, Kind]
    """`color`, `depth`, and those of `normals`, `occlusion` and `flow` that the data set has."""
    max_depth: float
    """Millimetres: the largest depth that counts."""
    releases: dict[str, str]
    """By video, which release of the data set its files follow."""
    example: ClassVar[str]
    """Two files that a frame needs, as a reader would write them."""
    dense_truth: ClassVar[bool] = False
    """Whether depth is known all over the field of view: what is unknown is then its border; see `Resize`."""

    def __init__(self, root: str | Path, videos: Sequence[str], camera: Camera, normals: str) -> None:
        self.root, self.camera = Path(root), camera
        self.normals = check_known("data.normals", normals, NORMALS)
        if normals == "stored" and "normals" not in self.kinds:
            raise DataError("data.normals: this data set stores none; take derived or none")
        self.frames: list[Frame] = []
        self.releases = {}
        self.notes: dict[Path, str] = {}
        for entry in videos:
            frames = self.find(entry)
            for frame in frames:
                self.check(frame)
            self.frames += frames

    def decoding(self) -> dict[str, Any] | None:
        """Options that decide what codes in files mean, where users choose them; None for all of its own."""
        return None

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
        """The folder of each video by its name, as they lay there when they were first asked for.

        Raises:
            DataError: there is no such root.
        """
        return self.video_folders(self.root)

    @property
    def calibrated(self) -> Camera:
        """The camera at the size that it was calibrated at."""
        return self.camera

    def needed(self, video: str = "") -> list[str]:
        """Kinds of files that are read; of a video that is known to have no truth, those that it has."""
        return ["color", "depth", *(["normals"] if self.normals == "stored" else [])]

    def refusal(self, video: str) -> str:
        """Why a video cannot be scored or trained on, whatever its files are; nothing of any other."""
        return ""

    def unreachable(self, video: str) -> str:
        """Why a video that lies there is not found; nothing of any other."""
        return ""

    def without_frames(self) -> str:
        """What is said where no folder has any frame."""
        reasons = (self.why_none(folder) for folder in self.folders.values())
        reason = next((f"; {why}" for why in reasons if why), "")
        return f"no frames {self.example} in any folder{reason}"

    def why_none(self, folder: Path) -> str:
        """Why a folder without images is so, where other files in it tell; else nothing."""
        return ""

    def renamed(self) -> dict[str, str]:
        """Videos that lie in folders of other names: the name here -> the name of the folder."""
        return {video: folder.name for video, folder in self.folders.items() if video != folder.name}

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, index: int) -> dict[str, Any]:
        frame = self.frames[index]
        return {
            "image": torch.from_numpy(self.image(index)).permute(2, 0, 1).float() / 255,
            **self.truth(index),
            "rays": self.camera.rays(),
            "video": frame.video,
            "frame": frame.number,
        }

    def image(self, index: int) -> np.ndarray:
        """RGB (h, w, 3) in 8 bits."""
        path, exact = self.frames[index].files["color"], self.kinds["color"].bits is not None
        size_hw = self.camera.size_hw
        return read_rgb(path, size_hw, np.uint8) if exact else read_colour(path, size_hw)

    def truth(self, index: int, take: Take = everywhere) -> dict[str, Tensor]:
        """Depth (1, h, w) in mm, mask (1, h, w) and normals (3, h, w) where they are asked for.

        The mask is that of depth; normals that are not known are the zero vector.

        Args:
            index: of the frame.
            take: which pixels; what is not taken need not be decoded.
        """
        frame = self.frames[index]
        if self.normals == "derived":
            whole = self.depth_and_mask(frame, everywhere)
            smooth = self.without_steps(whole[0])
            normals = normals_from_depth(smooth[None], self.camera.rays(), whole[1][None])[0]
            depth, mask, normals = (_taken(values, take) for values in (*whole, normals))
        else:
            depth, mask = self.depth_and_mask(frame, take)
            if self.normals == "none":
                return {"depth": depth, "mask": mask}
            normals = self.stored_normals(frame, take).mul_(mask)
        return {"depth": depth, "normals": normals, "mask": mask}

    def depth_and_mask(self, frame: Frame, take: Take) -> tuple[Tensor, Tensor]:
        """Depth (1, h, w) in mm, 0 where unknown, and where it is known (1, h, w); nowhere without a file."""
        size_hw, view = self.camera.size_hw, self.field_of_view()
        if "depth" not in frame.files:
            nothing = torch.from_numpy(take(np.zeros(size_hw, np.float32)))[None]
            return nothing, nothing > 0
        depth = self.stored_depth(frame, take)
        known = depth.known if view is None else depth.known & take(view[0].numpy())
        mask = torch.from_numpy(known)[None]
        return torch.where(mask, torch.from_numpy(depth.mm)[None], 0.0), mask

    def stored_depth(self, frame: Frame, take: Take = everywhere) -> Depth:
        """Depth of a frame as its file says, whatever the field of view."""
        return self.decoded_depth(take(self.depth_codes(frame.files["depth"])))

    def depth_codes(self, path: Path) -> Shaped[np.ndarray, "h w"]:
        """Depth as it is stored in a file.

        Raises:
            DataError: the file is not what it should be.
        """
        return read_grey(path, self.camera.size_hw, np.uint16)

    @abstractmethod
    def decoded_depth(self, codes: Shaped[np.ndarray, "h w"]) -> Depth:
        """Depth by its codes, of all pixels or of some, as they are stored."""

    def field_of_view(self) -> Bool[Tensor, "1 h w"] | None:
        """Where the endoscope shows anything; None where it does everywhere."""
        return None

    def without_steps(self, depth: Tensor) -> Tensor:
        """Depth (1, h, w) to derive normals from; data sets that store it coarsely smooth its steps away."""
        return depth

    def stored_normals(self, frame: Frame, take: Take) -> Tensor:
        """Unit normals (3, h, w) in standard axes; the zero vector where none is stored.

        Only data sets that store normals, with `normals` among their `kinds`, implement it.
        """
        raise NotImplementedError

    def find(self, entry: str) -> list[Frame]:
        """The frames of an entry of a split, with the files that are needed.

        Raises:
            DataError: there is no such video, it cannot serve, a frame lacks a file, or was chosen before.
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
        found = self.files(folder, needed)
        frames = choose_frames(folder, selection, self.kinds, found, self.example)
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
            folder: of the video.
            kinds: that are looked for.
            twice: is told of a second file of one number.

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
            DataError: names the file, the rule and what came.
        """
        check_header(path, self.camera.size_hw, self.kinds[kind].channels, self.kinds[kind].bits)

    def _numbers(self, video: str) -> set[int]:
        return {frame.number for frame in self.frames if frame.video == video}


def _taken(values: Tensor, take: Take) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(take(values.movedim(0, -1).numpy()))).movedim(-1, 0)


def named(folders: Iterable[Path]) -> dict[str, Path]:
    """Folders by their names.

    Raises:
        DataError: a name is not UTF-8, so that no file of results could hold it.
    """
    found = {folder.name: folder for folder in folders}
    for name in found:
        try:
            name.encode()
        except UnicodeEncodeError:
            raise DataError(f"{name!r}: the name of this folder is not UTF-8; rename it") from None
    return found


def check_root(root: Path) -> None:
    """Refuse a root that is no folder.

    Raises:
        DataError: says what it should be.
    """
    if not root.is_dir():
        raise DataError(f"data.root={root}: no such folder; it holds one folder for each video")
