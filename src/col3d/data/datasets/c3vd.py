"""C3VD: registered colonoscopy videos with depth, normals and poses; and its second part, C3VDv2.

References:
    Bobrow, Golhar, Vijayan, Akshintala, Garcia, Durr: Colonoscopy 3D Video Dataset with Paired Depth from
    2D-3D Registration, Medical Image Analysis 2023.
    Golhar, Bobrow, Ngamruengphong, Durr: C3VDv2, Colonoscopy 3D Video Dataset with Enhanced Realism, 2025.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
import torch
from jaxtyping import Bool, Shaped
from torch import Tensor

from col3d.data.datasets.flow import decoded_flow
from col3d.data.datasets.frame_files import Frame, Kind
from col3d.data.datasets.frame_set import Depth, FrameSet, Take, everywhere
from col3d.data.datasets.octagon import octagon_mask
from col3d.data.datasets.pose_files import pose_rows
from col3d.data.datasets.release import (
    AGREEMENT,
    FULL_CODE,
    OFF_ORTHONORMAL,
    RELEASES,
    camera_to_world,
    disagreement,
    standard_normals,
)
from col3d.data.datasets.videos import canonical_name, catalogue
from col3d.data.files.image_files import read_grey, read_rgb
from col3d.errors import DataError
from col3d.geometry import Camera, OmnidirectionalCamera
from col3d.nearest_names import check_known
from col3d.registry import register_dataset

MAX_DEPTH = 100.0
"""Depth in mm of the highest code, which also stands for everything beyond."""
Release = Literal["auto", "current", "pre_2023_05"]
OCCLUSIONS = ("occlusions/{}_occlusion.tiff", "occlusions/{}_occlusion.png", "occlusion/{}_occlusion.png")


@register_dataset("c3vd", split="paper", normals="stored", label="C3VD", table=True, view=octagon_mask)
class C3VD(FrameSet):
    """C3VD as downloaded, one folder for each video, at full resolution; see `FrameSet`.

    Pixels count where the octagon shows them, the depth code is neither 0 nor 65535 (beyond 100 mm), and,
    with normals, a normal is known. Every file's header and length is checked when the set is built.

    Args:
        root: folder of the folders of videos.
        videos: names, labels of the paper, or frame ranges such as `cecum_t1_a:0-120`.
        release: `current`, `pre_2023_05`, or `auto`: recognised for each video by comparing its normals with
            the depth, or by the names of its files where it has none.
        normals: `stored` reads them, `derived` computes them from the depth, `none` leaves them out.
        camera: lens and size of the stored frames; C3VD's own at 1080 x 1350 when absent.
        truth: whether depth is needed; without it, only images and poses are used.

    Raises:
        DataError: names the file or video, the rule and what was found.
        ValueError: an unknown `release` or `normals`.
    """

    kinds: Mapping[str, Kind] = {
        "color": Kind("{}_color.png", 3, 8, ("rgb/{}.png",)),
        "depth": Kind("{}_depth.tiff", 1, 16, ("depth/{}_depth.tiff",)),
        "normals": Kind("{}_normals.tiff", 3, 16, ("normals/{}_normals.tiff",)),
        "occlusion": Kind("{}_occlusion.png", 1, 8, OCCLUSIONS),
        "flow": Kind("{}_flow.tiff", 3, 16, ("optical_flow/{}_flow.tiff",)),
    }
    example = "NNNN_color.png with NNNN_depth.tiff, or rgb/NNNN.png with depth/NNNN_depth.tiff"
    max_depth = MAX_DEPTH
    dense_truth = True
    data: ClassVar[str] = "c3vd"
    """Its name in the table of videos."""

    def __init__(
        self,
        root: str | Path,
        videos: Sequence[str],
        release: Release = "auto",
        normals: str = "stored",
        camera: Camera | None = None,
        truth: bool = True,
    ) -> None:
        check_known("data.release", release, ("auto", *RELEASES))
        self.with_truth = truth
        super().__init__(root, videos, camera or self.lens(), normals)
        for video in dict.fromkeys(frame.video for frame in self.frames if "depth" in frame.files):
            self.releases[video] = self._release_of([f for f in self.frames if f.video == video], release)

    @staticmethod
    def lens() -> Camera:
        """The camera of the data set at the size of its frames."""
        return OmnidirectionalCamera.c3vd()

    def decoding(self) -> dict[str, Any]:
        """Nothing: the release that files follow is known for each video."""
        return {}

    @property
    def calibrated(self) -> Camera:
        """The data set's own lens, if the frames were seen through it, at any size."""
        lens = self.lens()
        return lens if lens.resized(self.camera.size_hw) == self.camera else self.camera

    @classmethod
    def video_folders(cls, root: Path) -> dict[str, Path]:
        """The folder of each video by its name here, whichever of its names the folder has.

        Raises:
            DataError: there is no such root, or two folders are of one video.
        """
        folders: dict[str, Path] = {}
        for name, folder in super().video_folders(root).items():
            first = folders.setdefault(canonical_name(name), folder)
            if first != folder:
                raise DataError(f"{folder}: the same video as {first.name}; keep one of them")
        return {video: _unwrapped(folder) for video, folder in folders.items()}

    def needed(self, video: str = "") -> list[str]:
        """Kinds of files that are read; for a video without truth, only images."""
        row = catalogue().get(video)
        return super().needed(video) if self.with_truth and (row is None or row.has_truth) else ["color"]

    def refusal(self, video: str) -> str:
        """Reason why a video cannot be used: it is of another data set, or lacks needed truth; else empty."""
        row = catalogue().get(video)
        if row is not None and row.data != self.data:
            return (
                f"{row.released_as} is a video of {row.data}, which another lens saw; take data={row.data}, "
                "or add it by data.also"
            )
        if row is not None and self.with_truth and not row.has_truth:
            return (
                f"{row.name} is a {row.kind} video, which has images and poses but no depth; col3d predict "
                "and col3d fuse take it"
            )
        return ""

    def occlusion(self, index: int) -> Tensor | None:
        """Where another surface lies behind the visible one within 100 mm: (1, h, w) bool; None without file.

        Raises:
            DataError: the file is not what it should be.
        """
        path = self._beside(index, "occlusion")
        if path is None:
            return None
        return torch.from_numpy(read_grey(path, self.camera.size_hw, np.uint8) > 0)[None]

    def flow(self, index: int) -> tuple[Tensor, Tensor] | None:
        """Where each pixel was in the frame before: (2, h, w) in pixels, and where that is known (1, h, w).

        The pixel there minus the pixel here, x first. None without a file, as for the first frame.

        Raises:
            DataError: the file is not what it should be.
        """
        path = self._beside(index, "flow")
        if path is None:
            return None
        pixels, known = decoded_flow(read_rgb(path, self.camera.size_hw, np.uint16))
        return torch.from_numpy(pixels).permute(2, 0, 1), torch.from_numpy(known)[None]

    def _beside(self, index: int, kind: str) -> Path | None:
        """Path of an optional file of a frame; None where it does not exist."""
        frame = self.frames[index]
        return self.kinds[kind].at(self.folders[frame.video], frame.number)

    def poses(self, video: str) -> Tensor:
        """Camera-to-world matrices of a whole video, (n, 4, 4) float64 in mm; line k belongs to frame k.

        Raises:
            DataError: there is no such video, or its pose.txt is missing or malformed.
        """
        folder = self.folders.get(canonical_name(video))
        if folder is None:
            raise DataError(f"{self.root / video}: no such video")
        path = folder / "pose.txt"
        if not path.is_file():
            raise DataError(f"{path}: no such file; the poses of a video are in it, a line a frame")
        try:
            poses = camera_to_world(np.array(pose_rows(path)))
            turns = poses[:, :3, :3]
            off = np.abs(turns @ turns.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
            fine = np.isfinite(poses).all(axis=(1, 2)) & (off < OFF_ORTHONORMAL)
            fine[fine] = np.linalg.det(turns[fine]) > 0  # a matrix that mirrors is no rotation
            if not fine.all():
                raise ValueError(f"line {int(np.argmin(fine)) + 1} is no rotation with a place")
            return torch.from_numpy(poses)
        except (OSError, ValueError) as error:
            raise DataError(f"{path}: expected lines of 16 comma-separated numbers ({error})") from None

    def decoded_depth(self, codes: Shaped[np.ndarray, "h w"]) -> Depth:
        """Decode depth, of all pixels or of some.

        The renderer truncates codes, so that depth is in [v, v + 1) steps of 0.0015 mm; v itself is read, as
        the data set's own page says, which is half a step too near on average.
        """
        mm = codes.astype(np.float32) * np.float32(MAX_DEPTH / FULL_CODE)
        return Depth(mm, (codes > 0) & (codes < FULL_CODE))

    def field_of_view(self) -> Bool[Tensor, "1 h w"]:
        """The octagon of the endoscope."""
        return octagon_mask(self.camera.size_hw)

    def stored_normals(self, frame: Frame, take: Take) -> Tensor:
        """Unit normals (3, h, w) in standard axes; the zero vector where none is stored."""
        return standard_normals(self.normal_codes(frame, take), self.releases[frame.video])

    def normal_codes(self, frame: Frame, take: Take = everywhere) -> np.ndarray:
        """Normals (h, w, 3) as they are stored."""
        return take(read_rgb(frame.files["normals"], self.camera.size_hw, np.uint16))

    def _release_of(self, frames: list[Frame], release: str) -> str:
        """The release that a video follows; refuse stored normals that contradict the requested one."""
        middle = frames[len(frames) // 2].number
        for frame in sorted(frames, key=lambda frame: abs(frame.number - middle)):
            if "normals" not in frame.files:
                break
            depth, mask = self.depth_and_mask(frame, everywhere)
            angles = disagreement(self.normal_codes(frame), depth, mask, self.camera)
            if not any(math.isnan(angle) for angle in angles.values()):  # there is depth to compare them with
                return _agreed(frame.files["normals"], angles, release)
        padded = frames[0].files["depth"].name.split("_")[0] == f"{frames[0].number:04d}"
        return release if release != "auto" else RELEASES[0 if padded else 1]


def _unwrapped(folder: Path) -> Path:
    """A folder, or the folder of the same name in it that an archive has added."""
    inner = folder / folder.name
    return inner if inner.is_dir() and not any(folder.glob("[!.]*.*")) else folder


def _agreed(path: Path, angles: Mapping[str, float], release: str) -> str:
    """The release that stored normals follow by their angles to those of the depth; refuse a wrong one."""
    best = min(RELEASES, key=lambda name: angles[name])
    if angles[best] > AGREEMENT or (release not in ("auto", best) and angles[release] > AGREEMENT):
        raise DataError(
            f"{path}: normals do not follow data.release={release}: their median angle to the normals of the "
            f"depth is {angles['current']:.0f} degrees read as current, {angles['pre_2023_05']:.0f} read as "
            "pre_2023_05"
        )
    return best if release == "auto" else release
