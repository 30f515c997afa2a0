"""Small videos in both releases' formats, of a scene known in closed form."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch

from col3d.geometry import OmnidirectionalCamera

SMALL_LENS = OmnidirectionalCamera.c3vd().resized((108, 135))
WriteVideo = Callable[..., Path]


def codes_of(
    release: str, depth: np.ndarray, normals: np.ndarray, known: np.ndarray
) -> dict[str, np.ndarray]:
    """16-bit codes as the data set's page describes them; nothing of the package."""
    depth_codes = np.where(np.isnan(depth), 0, np.clip(depth, 0, 100) / 100 * 65535).round()
    x, y, z = normals
    coded = np.stack(
        [(x + 1) / 2, (y + 1) / 2, (z + 1) / 2]
        if release == "current"
        else [(x + 1) / 2, (1 - y) / 2, np.maximum(-z, 0)],
        axis=-1,
    )
    normal_codes = np.where(known[..., None], coded * 65535, 0).round()
    return {"depth": depth_codes.astype(np.uint16), "normals": normal_codes.astype(np.uint16)}


def pose_lines(count: int, release: str) -> tuple[np.ndarray, np.ndarray]:
    """Camera-to-world matrices, and the lines of pose.txt that stand for them."""
    angles = np.linspace(0, 1, count)
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, 0, 0] = poses[:, 1, 1] = np.cos(angles)
    poses[:, 1, 0], poses[:, 0, 1] = np.sin(angles), -np.sin(angles)
    poses[:, :3, 3] = np.stack([angles * 10 + 1, angles - 5, angles + 7], axis=1)
    return poses, (poses.transpose(0, 2, 1) if release == "current" else poses).reshape(count, 16)


@pytest.fixture
def write_video(tmp_path: Path, look: Any) -> WriteVideo:
    """Write a video below tmp_path / "c3vd" and return that root."""

    def write(
        video: str = "cecum_t1_a",
        numbers: Sequence[int] = (0, 1, 2),
        release: str = "current",
        scene: str = "tube",
        stored: str | None = None,
    ) -> Path:
        root = tmp_path / "c3vd"
        folder = root / video
        folder.mkdir(parents=True)
        depth, normals, mask = look(scene, SMALL_LENS.rays())
        known = mask[0, 0].numpy()
        codes = codes_of(stored or release, np.where(known, depth[0, 0], np.nan), normals[0].numpy(), known)
        for number in numbers:
            name = f"{number:04d}" if release == "current" else str(number)
            color = np.zeros((108, 135, 3), np.uint8)
            color[..., 0], color[..., 1] = number, 200  # red tells the frame; green is bright
            assert cv2.imwrite(str(folder / f"{name}_color.png"), color[..., ::-1])
            assert cv2.imwrite(str(folder / f"{name}_depth.tiff"), codes["depth"])
            assert cv2.imwrite(str(folder / f"{name}_normals.tiff"), codes["normals"][..., ::-1])
        np.savetxt(folder / "pose.txt", pose_lines(len(numbers), release)[1], delimiter=",")
        return root

    return write


@pytest.fixture
def lens() -> OmnidirectionalCamera:
    """The camera of the small videos."""
    return SMALL_LENS


@pytest.fixture
def item(look: Any) -> dict[str, Any]:
    """One frame in standard units, of a sphere, with an invalid corner and pixels that are not square."""
    camera = OmnidirectionalCamera.c3vd().resized((120, 120))
    depth, normals, mask = look("sphere", camera.rays())
    mask[..., :20, :30] = False
    known = mask[0]
    return {
        "image": torch.randint(0, 256, (3, 120, 120), generator=torch.Generator().manual_seed(0)) / 255,
        "depth": torch.where(known, depth[0].float(), 0.0),
        "normals": torch.where(known, normals[0].float(), 0.0),
        "mask": known,
        "rays": camera.rays(),
        "video": "cecum_t1_a",
        "frame": 3,
        "camera": camera,
    }
