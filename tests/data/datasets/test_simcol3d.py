"""SimCol3D: its folders, its codes, its pinhole, and normals that do not show the steps of its depth."""

import os
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from refusals import refused

from col3d.data.datasets.simcol3d import SimCol3D
from col3d.errors import DataError
from col3d.geometry import PinholeCamera, angle_between, normals_from_depth

SAMPLE = os.environ.get("COL3D_C3VD_SAMPLE")


@pytest.fixture
def root(tmp_path: Path, look: Any) -> Path:
    """Two videos in two scenes, of a tube, in the format of the data set with depth of 8 bits."""
    depth, _, mask = look("tube", SimCol3D.lens().rays())
    for folder, count in (("SyntheticColon_I/Frames_S1", 2), ("SyntheticColon_II/Frames_B4", 1)):
        (tmp_path / folder).mkdir(parents=True)
        for number in range(count):
            millimetres = torch.where(mask, depth, 0.0)[0, 0].numpy()
            codes = (np.round(millimetres / 200 * 255) * 256).astype(np.uint16)
            colour = np.full((475, 475, 4), (10 * 257, 200 * 257, number * 257, 65535), np.uint16)
            cv2.imwrite(str(tmp_path / folder / f"Depth_{number:04d}.png"), codes)
            cv2.imwrite(str(tmp_path / folder / f"FrameBuffer_{number:04d}.png"), colour)
    return tmp_path


def test_videos_are_found_below_their_scenes(root: Path) -> None:
    assert list(SimCol3D.video_folders(root)) == ["Frames_S1", "Frames_B4"]
    frames = SimCol3D(root, ["Frames_B4", "Frames_S1:1-1"])
    assert [(frame.video, frame.number) for frame in frames.frames] == [("Frames_B4", 0), ("Frames_S1", 1)]
    with refused(DataError, None, "video 'Frames_S2'", "'Frames_S1'"):
        SimCol3D(root, ["Frames_S2"])


def test_what_lies_in_a_video_or_too_deep_is_none(root: Path) -> None:
    colour = (root / "SyntheticColon_I" / "Frames_S1" / "FrameBuffer_0000.png").read_bytes()
    for folder in ("zip/SyntheticColon_III/Frames_O1", "a/b/c/Frames_O2", "SyntheticColon_I/Frames_S1/Old"):
        (root / folder).mkdir(parents=True)
        (root / folder / "FrameBuffer_0000.png").write_bytes(colour)
    (root / "linked").symlink_to(root / "zip" / "SyntheticColon_III" / "Frames_O1")
    assert SimCol3D.video_folders(root) == {
        "Frames_S1": root / "SyntheticColon_I" / "Frames_S1",
        "Frames_B4": root / "SyntheticColon_II" / "Frames_B4",
        "linked": root / "linked",
        "Frames_O1": root / "zip" / "SyntheticColon_III" / "Frames_O1",
    }


def test_depth_colours_and_rays(root: Path, look: Any) -> None:
    item = SimCol3D(root, ["Frames_S1"])[1]
    v, u = 100, 300
    ray = np.array([(u - 227.6) / 227.6, (v - 237.5) / 227.6, 1.0])
    np.testing.assert_allclose(item["rays"][:, v, u], ray / np.linalg.norm(ray), atol=1e-6)
    depth, _, mask = look("tube", item["rays"])
    assert torch.equal(item["mask"], mask[0] & (item["depth"] > 0))
    assert (item["depth"] - depth[0])[item["mask"]].abs().max() < 200 / 255 / 2 + 1e-4
    assert (item["image"][:, 0, 0] * 255).tolist() == [1, 200, 10]


def test_normals_of_depth_in_steps_are_those_of_the_surface(root: Path, look: Any) -> None:
    item = SimCol3D(root, ["Frames_S1"])[0]
    _, normals, _ = look("tube", item["rays"])
    off = angle_between(item["normals"], normals[0].float())[item["mask"]]
    raw = normals_from_depth(item["depth"][None], item["rays"], item["mask"][None])[0]
    raw_off = angle_between(raw, normals[0].float())[item["mask"]]
    assert off.median() < 1
    assert raw_off.median() > 15


def test_stored_normals_are_not_to_be_had(root: Path) -> None:
    with refused(DataError, "data.normals", "derived or none"):
        SimCol3D(root, ["Frames_S1"], normals="stored")


@pytest.mark.skipif(SAMPLE is None, reason="COL3D_C3VD_SAMPLE names no folder of real frames")
def test_real_frames() -> None:
    frames = SimCol3D(Path(str(SAMPLE)), ["simcol3d_sample"])
    assert [frame.number for frame in frames.frames] == [0, 4, 9]
    item = frames[0]
    assert isinstance(frames.camera, PinholeCamera)
    assert item["mask"].all()
    assert 6 < item["depth"].min() < 7
    assert 133 < item["depth"].max() < 134
    red, green, blue = item["image"].mean(dim=(1, 2))
    assert red > green > blue
    assert (item["normals"] * item["rays"]).sum(dim=0).max() < 0
    flat = (angle_between(item["normals"], -item["rays"])[0] < 1).float().mean()
    assert flat < 0.05, "terraces face the camera"
