"""C3VD: registered colonoscopy videos with depth, normals and poses.

References:
    Bobrow, Golhar, Vijayan, Akshintala, Garcia, Durr: Colonoscopy 3D Video Dataset with Paired Depth from
    2D-3D Registration, Medical Image Analysis 2023.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import Dataset

from col3d.checks import DataError, check_known
from col3d.data.files import check_header, read_grey, read_rgb
from col3d.data.octagon import octagon_mask
from col3d.data.release import AGREEMENT, FULL_CODE, RELEASES, camera_to_world, disagreement, house_normals
from col3d.data.splits import Selection, parse_selection
from col3d.geometry import Camera, OmnidirectionalCamera, normals_from_depth

MAX_DEPTH = 100.0
"""Depth in mm of the highest code, which also stands for everything beyond."""
KINDS = {"color": (".png", 3, 8), "depth": (".tiff", 1, 16), "normals": (".tiff", 3, 16)}
"""Ending, channels and bits of each kind of file."""
NORMALS = ("stored", "derived", "none")


@dataclass(frozen=True)
class Frame:
    """Where one frame lies."""

    video: str
    number: int
    color: Path
    depth: Path
    normals: Path | None


class C3VD(Dataset[dict[str, Any]]):
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

    def __init__(
        self,
        root: str | Path,
        videos: Sequence[str],
        release: str = "auto",
        normals: str = "stored",
        camera: Camera | None = None,
    ) -> None:
        self.root = Path(root)
        self.camera = camera or OmnidirectionalCamera.c3vd()
        self.normals = check_known("data.normals", normals, NORMALS)
        check_known("data.release", release, ("auto", *RELEASES))
        present = video_folders(self.root)
        self.releases: dict[str, str] = {}
        self.frames: list[Frame] = []
        for entry in videos:
            frames = self._frames_of(parse_selection(entry, present))
            if twice := set(frames) & set(self.frames):
                first = min(twice, key=lambda frame: frame.number)
                raise DataError(
                    f"split entry {entry!r}: frame {first.number} of {first.video} is chosen already"
                )
            self.releases[frames[0].video] = self._release_of(frames, release)
            self.frames += frames

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, index: int) -> dict[str, Any]:
        frame = self.frames[index]
        image = read_rgb(frame.color, self.camera.size_hw, np.uint8)
        depth, mask = self._depth_and_mask(frame)
        item: dict[str, Any] = {
            "image": torch.from_numpy(image).permute(2, 0, 1).float() / 255,
            "depth": depth,
            "mask": mask,
            "rays": self.camera.rays(),
            "video": frame.video,
            "frame": frame.number,
        }
        if self.normals != "none":
            item["normals"] = self._normals(frame, depth, mask)
            item["mask"] = mask & (item["normals"] != 0).any(dim=0, keepdim=True)
        return item

    def occlusion(self, index: int) -> Tensor | None:
        """Where another surface lies behind the seen one within 100 mm: (1, h, w) bool, or None without file.

        Raises:
            DataError: the file is not what it should be.
        """
        frame = self.frames[index]
        path = frame.color.with_name(f"{frame.number:04d}_occlusion.png")
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
            lines = path.read_text(encoding="utf-8").splitlines()
            rows = [[float(number) for number in line.split(",")] for line in lines if line.strip()]
            if {len(row) for row in rows} != {16}:
                raise ValueError(f"got {len(rows)} lines of {sorted({len(row) for row in rows})}")
            return torch.from_numpy(camera_to_world(np.array(rows)))
        except (OSError, ValueError) as error:
            raise DataError(f"{path}: expected lines of 16 comma-separated numbers ({error})") from None

    def _frames_of(self, selection: Selection) -> list[Frame]:
        folder = self.root / selection.video
        if not folder.is_dir():
            raise DataError(f"{folder}: no such video; copy it there or leave it out of data.split")
        kinds = {kind: numbered(folder, kind, ending) for kind, (ending, _, _) in KINDS.items()}
        chosen = sorted(n for n in kinds["color"].keys() | kinds["depth"].keys() if n in selection)
        if not chosen:
            raise DataError(f"{folder}: no frames NNNN_color.png with NNNN_depth.tiff for {selection} in it")
        needed = ["color", "depth", *(["normals"] if self.normals == "stored" else [])]
        for kind in needed:
            for number in chosen:
                if number not in kinds[kind]:
                    raise DataError(missing_file(folder, kind, number))
                check_header(kinds[kind][number], self.camera.size_hw, *KINDS[kind][1:])
        stored = kinds["normals"] if self.normals == "stored" else {}
        return [
            Frame(selection.video, n, kinds["color"][n], kinds["depth"][n], stored.get(n)) for n in chosen
        ]

    def _release_of(self, frames: list[Frame], release: str) -> str:
        """The release that a video follows; stored normals that contradict the one asked for are refused."""
        middle = frames[len(frames) // 2].number
        for frame in sorted(frames, key=lambda frame: abs(frame.number - middle)):
            if frame.normals is None:
                break
            codes = read_rgb(frame.normals, self.camera.size_hw, np.uint16)
            angles = disagreement(codes, *self._depth_and_mask(frame), self.camera)
            if not any(math.isnan(angle) for angle in angles.values()):  # some depth to hold them against
                return _agreed(frame.normals, angles, release)
        padded = frames[0].depth.name.split("_")[0] == f"{frames[0].number:04d}"
        return release if release != "auto" else RELEASES[0 if padded else 1]

    def _depth_and_mask(self, frame: Frame) -> tuple[Tensor, Tensor]:
        codes = read_grey(frame.depth, self.camera.size_hw, np.uint16)
        known = torch.from_numpy((codes > 0) & (codes < FULL_CODE))[None] & octagon_mask(self.camera.size_hw)
        depth = torch.from_numpy(codes.astype(np.float32))[None] * (MAX_DEPTH / FULL_CODE)
        return torch.where(known, depth, 0.0), known

    def _normals(self, frame: Frame, depth: Tensor, mask: Tensor) -> Tensor:
        if frame.normals is None:
            return normals_from_depth(depth[None], self.camera.rays(), mask[None])[0]
        codes = read_rgb(frame.normals, self.camera.size_hw, np.uint16)
        return torch.where(mask, house_normals(codes, self.releases[frame.video]), 0.0)


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


def video_folders(root: Path) -> list[str]:
    """Names of the folders of a data set.

    Raises:
        DataError: there is no such folder.
    """
    if not root.is_dir():
        raise DataError(f"data.root={root}: no such folder; it holds one folder for each video")
    return sorted(path.name for path in root.iterdir() if path.is_dir() and not path.name.startswith("."))


def numbered(folder: Path, kind: str, ending: str) -> dict[int, Path]:
    """Files of one kind by frame number, whether the number in their name is padded or not.

    Raises:
        DataError: two files have the same number.
    """
    pattern = re.compile(rf"(\d+)_{kind}\{ending}")
    found: dict[int, Path] = {}
    for path in sorted(folder.iterdir()):
        if match := pattern.fullmatch(path.name):
            first = found.setdefault(int(match.group(1)), path)
            if first != path:
                raise DataError(f"{path}: the same frame as {first.name}; keep one of them")
    return found


def missing_file(folder: Path, kind: str, number: int) -> str:
    """What to say of a frame that lacks a file."""
    hint = "; data.normals=derived computes them from the depth" if kind == "normals" else ""
    return f"{folder}: frame {number} has no {number:04d}_{kind}{KINDS[kind][0]}{hint}"
