"""Base of all data sets: frames decoded to standard units."""

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
from jaxtyping import Bool, Float32, Shaped
from torch import Tensor
from torch.utils.data import Dataset

from col3d.data.datasets.dataset_index import DatasetIndex
from col3d.data.datasets.frame_files import Frame
from col3d.data.files.image_files import read_colour, read_grey, read_rgb
from col3d.errors import DataError
from col3d.geometry import Camera, normals_from_depth
from col3d.nearest_names import check_known

NORMALS = ("stored", "derived", "none")
Take = Callable[[np.ndarray], np.ndarray]
"""Function that selects pixels of an array (h, w) or (h, w, c)."""


def everywhere(values: np.ndarray) -> np.ndarray:
    """Take all pixels."""
    return values


@dataclass(frozen=True)
class Depth:
    """Depth of one frame.

    Attributes:
        mm: millimetres along the optical axis; meaningless where it is not known.
        known: where its code counts, also outside the field of view.
    """

    mm: Float32[np.ndarray, "h w"]
    known: Bool[np.ndarray, "h w"]


class FrameSet(DatasetIndex, Dataset[dict[str, Any]]):
    """Frames of chosen videos at full resolution, in standard units: the keys of a `Batch` less its axis b.

    Every file's header and length is checked when the set is built.

    Args:
        root: folder of the folders of videos.
        videos: names, labels of the paper, or frame ranges such as `cecum_t1_a:0-120`.
        camera: lens and size of the stored frames.
        normals: `stored` reads them, `derived` computes them from the depth, `none` leaves them out.

    Attributes:
        frames: frames of the chosen videos.
        notes: by the folder of a video, how its files were paired, where not simply by number.

    Raises:
        DataError: names the file or video, the rule and what was found.
        ValueError: unknown `normals`, or `stored` where the data set has none.
    """

    max_depth: float
    """Millimetres: the largest depth that counts."""
    releases: dict[str, str]
    """Release of the data set that a video's files follow, by video."""
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
        """Options that decide the meaning of codes, where users choose them; None for all own options."""
        return None

    @property
    def calibrated(self) -> Camera:
        """The camera at the size that it was calibrated at."""
        return self.camera

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
        """Image as RGB (h, w, 3) in 8 bits."""
        path, exact = self.frames[index].files["color"], self.kinds["color"].bits is not None
        size_hw = self.camera.size_hw
        return read_rgb(path, size_hw, np.uint8) if exact else read_colour(path, size_hw)

    def truth(self, index: int, take: Take = everywhere) -> dict[str, Tensor]:
        """Depth (1, h, w) in mm, mask (1, h, w), and normals (3, h, w) unless they are left out.

        The mask is that of depth; normals that are not known are the zero vector.

        Args:
            index: index of the frame.
            take: selects pixels; others need not be decoded.
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
        """Depth of a frame as its file has it, whatever the field of view."""
        return self.decoded_depth(take(self.depth_codes(frame.files["depth"])))

    def depth_codes(self, path: Path) -> Shaped[np.ndarray, "h w"]:
        """Depth as it is stored in a file.

        Raises:
            DataError: the file is not what it should be.
        """
        return read_grey(path, self.camera.size_hw, np.uint16)

    @abstractmethod
    def decoded_depth(self, codes: Shaped[np.ndarray, "h w"]) -> Depth:
        """Decode depth, of all pixels or of some."""

    def field_of_view(self) -> Bool[Tensor, "1 h w"] | None:
        """Pixels at which the endoscope shows anything; None where it does everywhere."""
        return None

    def without_steps(self, depth: Tensor) -> Tensor:
        """Smooth depth (1, h, w) to derive normals from, for data sets that store it in coarse steps."""
        return depth

    def stored_normals(self, frame: Frame, take: Take) -> Tensor:
        """Unit normals (3, h, w) in standard axes; the zero vector where none is stored.

        Only data sets that store normals, with `normals` among their `kinds`, implement it.
        """
        raise NotImplementedError


def _taken(values: Tensor, take: Take) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(take(values.movedim(0, -1).numpy()))).movedim(-1, 0)
