"""C3VD: registered colonoscopy videos with depth, normals and poses; and its second part, C3VDv2.

References:
    Bobrow, Golhar, Vijayan, Akshintala, Garcia, Durr: Colonoscopy 3D Video Dataset with Paired Depth from
    2D-3D Registration, Medical Image Analysis 2023.
    Golhar, Bobrow, Ngamruengphong, Durr: C3VDv2, Colonoscopy 3D Video Dataset with Enhanced Realism, 2025.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Shaped
from torch import Tensor

from col3d.checks import DataError, check_known
from col3d.data.files import read_grey, read_rgb
from col3d.data.frames import Depth, Frame, FrameSet, Kind, Take, everywhere
from col3d.data.octagon import octagon_mask
from col3d.data.release import (
    AGREEMENT,
    FULL_CODE,
    OFF_ORTHONORMAL,
    RELEASES,
    camera_to_world,
    disagreement,
    house_normals,
)
from col3d.geometry import Camera, OmnidirectionalCamera

MAX_DEPTH = 100.0
"""Depth in mm of the highest code, which also stands for everything beyond."""


class C3VD(FrameSet):
    """Frames of chosen videos at full resolution, in house units: the keys of a `Batch` without its axis b.

    Pixels count where the octagon shows them, the depth code is neither 0 nor 65535 (beyond 100 mm), and,
    with normals, a normal is known. Every file's header and length is checked when the set is built.

    Args:
        root: folder of the folders of videos.
        videos: names, labels of the paper, or frame ranges such as `cecum_t1_a:0-120`.
        release: `current`, `pre_2023_05`, or `auto`: told for each video by its normals, held against the
            depth, or by the names of its files where it has none.
        normals: `stored` reads them, `derived` computes them from the depth, `none` leaves them out.
        camera: lens and size of the stored frames; C3VD's own at 1080 x 1350 when absent.

    Raises:
        DataError: names the file or video, the rule and what came.
        ValueError: an unknown `release` or `normals`.
    """

    kinds: Mapping[str, Kind] = {
        "color": Kind("{}_color.png", 3, 8),
        "depth": Kind("{}_depth.tiff", 1, 16),
        "normals": Kind("{}_normals.tiff", 3, 16),
        "occlusion": Kind("{}_occlusion.png", 1, 8),
        "flow": Kind("{}_flow.tiff", 3, 16),
    }
    example = "NNNN_color.png with NNNN_depth.tiff"
    max_depth = MAX_DEPTH

    def __init__(
        self,
        root: str | Path,
        videos: Sequence[str],
        release: str = "auto",
        normals: str = "stored",
        camera: Camera | None = None,
    ) -> None:
        check_known("data.release", release, ("auto", *RELEASES))
        super().__init__(root, videos, camera or self.lens(), normals)
        self.releases = {}
        for video in dict.fromkeys(frame.video for frame in self.frames):
            self.releases[video] = self._release_of([f for f in self.frames if f.video == video], release)

    @staticmethod
    def lens() -> Camera:
        """The camera of the data set at the size of its frames."""
        return OmnidirectionalCamera.c3vd()

    def occlusion(self, index: int) -> Tensor | None:
        """Where another surface lies behind the seen one within 100 mm: (1, h, w) bool, or None without file.

        Raises:
            DataError: the file is not what it should be.
        """
        frame = self.frames[index]
        path = self.root / frame.video / self.kinds["occlusion"].named(frame.number)
        if not path.is_file():
            return None
        return torch.from_numpy(read_grey(path, self.camera.size_hw, np.uint8) > 0)[None]

    def poses(self, video: str) -> Tensor:
        """Camera-to-world matrices of a whole video, (n, 4, 4) float64 in mm; line k belongs to frame k.

        Raises:
            DataError: pose.txt is missing or malformed.
        """
        path = self.root / video / "pose.txt"
        try:
            lines = path.read_text(encoding="utf-8").rstrip().splitlines()
            rows = [[float(number) for number in line.split(",")] for line in lines]
            if {len(row) for row in rows} != {16}:
                raise ValueError(f"got {len(rows)} lines of {sorted({len(row) for row in rows})}")
            poses = camera_to_world(np.array(rows))
            turns = poses[:, :3, :3]
            off = np.abs(turns @ turns.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
            if not (fine := np.isfinite(poses).all(axis=(1, 2)) & (off < OFF_ORTHONORMAL)).all():
                raise ValueError(f"line {int(np.argmin(fine)) + 1} is no rotation with a place")
            return torch.from_numpy(poses)
        except (OSError, ValueError) as error:
            raise DataError(f"{path}: expected lines of 16 comma-separated numbers ({error})") from None

    def decoded_depth(self, codes: Shaped[np.ndarray, "h w"]) -> Depth:
        """Depth by its codes, of all pixels or of some, as they are stored."""
        mm = codes.astype(np.float32) * np.float32(MAX_DEPTH / FULL_CODE)
        return Depth(mm, (codes > 0) & (codes < FULL_CODE))

    def field_of_view(self) -> Bool[Tensor, "1 h w"]:
        """The octagon of the endoscope."""
        return octagon_mask(self.camera.size_hw)

    def stored_normals(self, frame: Frame, take: Take) -> Tensor:
        """Unit normals (3, h, w) in house axes; the zero vector where none is stored."""
        return house_normals(self.normal_codes(frame, take), self.releases[frame.video])

    def normal_codes(self, frame: Frame, take: Take = everywhere) -> np.ndarray:
        """Normals (h, w, 3) as they are stored."""
        return take(read_rgb(frame.files["normals"], self.camera.size_hw, np.uint16))

    def _release_of(self, frames: list[Frame], release: str) -> str:
        """The release that a video follows; stored normals that contradict the one asked for are refused."""
        middle = frames[len(frames) // 2].number
        for frame in sorted(frames, key=lambda frame: abs(frame.number - middle)):
            if "normals" not in frame.files:
                break
            depth, mask = self.depth_and_mask(frame, everywhere)
            angles = disagreement(self.normal_codes(frame), depth, mask, self.camera)
            if not any(math.isnan(angle) for angle in angles.values()):  # some depth to hold them against
                return _agreed(frame.files["normals"], angles, release)
        padded = frames[0].files["depth"].name.split("_")[0] == f"{frames[0].number:04d}"
        return release if release != "auto" else RELEASES[0 if padded else 1]


class C3VDv2(C3VD):
    """The videos of C3VDv2: another lens, and a folder for each kind of file; else as `C3VD`."""

    kinds: Mapping[str, Kind] = {
        "color": Kind("rgb/{}.png", 3, 8),
        "depth": Kind("depth/{}_depth.tiff", 1, 16),
        "normals": Kind("normals/{}_normals.tiff", 3, 16),
        "occlusion": Kind("occlusion/{}_occlusion.png", 1, 8),
    }
    example = "rgb/NNNN.png with depth/NNNN_depth.tiff"

    @staticmethod
    def lens() -> Camera:
        """The camera of the data set at the size of its frames."""
        return OmnidirectionalCamera.c3vdv2()


def _agreed(path: Path, angles: Mapping[str, float], release: str) -> str:
    """The release that stored normals at these angles to those of the depth follow, if it may be that one."""
    best = min(RELEASES, key=lambda name: angles[name])
    if angles[best] > AGREEMENT or (release not in ("auto", best) and angles[release] > AGREEMENT):
        raise DataError(
            f"{path}: normals do not follow data.release={release}: their median angle to the normals of the "
            f"depth is {angles['current']:.0f} degrees read as current, {angles['pre_2023_05']:.0f} read as "
            "pre_2023_05"
        )
    return best if release == "auto" else release
