"""Your own frames: any layout, any unit of depth, any camera; what does not fit is said in a line."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from refusals import refused

from col3d.data.datasets.folder import FolderFrames
from col3d.errors import DataError
from col3d.geometry import PinholeCamera, angle_between

CAMERA = PinholeCamera.from_focal((60, 80), 70.0, 71.0, 39.5, 29.5)
LAYOUT = {"image": "rgb/img_{}.jpg", "depth": "depth/{}.tiff", "depth_unit": 1000.0, "max_depth": 90.0}


@pytest.fixture
def root(tmp_path: Path, look: Any) -> Path:
    """A video of two frames of a sphere, with depth in metres as floats."""
    depth, _, mask = look("sphere", CAMERA.rays())
    metres = torch.where(mask, depth / 1000, torch.nan)[0, 0].numpy().astype(np.float32)
    for name in ("rgb", "depth"):
        (tmp_path / "clip_1" / name).mkdir(parents=True)
    for number in (3, 12):
        image = np.full((60, 80, 3), 50 + number, np.uint8)
        cv2.imwrite(str(tmp_path / "clip_1" / "rgb" / f"img_{number}.jpg"), image)
        cv2.imwrite(str(tmp_path / "clip_1" / "depth" / f"{number:06d}.tiff"), metres)
    plain = {"model": "pinhole", "size": [60, 80], "fx": 70.0, "fy": 71.0, "cx": 39.5, "cy": 29.5}
    (tmp_path / "camera.json").write_text(json.dumps(plain))
    return tmp_path


def test_frames_of_a_described_folder(root: Path, look: Any) -> None:
    frames = FolderFrames(root, ["clip_1"], **LAYOUT)
    assert [frame.number for frame in frames.frames] == [3, 12]
    assert frames.camera == CAMERA
    item = frames[1]
    depth, normals, mask = look("sphere", CAMERA.rays())
    counts = mask[0] & (depth[0] <= 90)
    known = item["mask"]
    assert (counts | ~known).all()
    assert known.sum() > 0.9 * counts.sum()
    torch.testing.assert_close(item["depth"][known], depth[0][known].float(), rtol=1e-5, atol=0)
    assert angle_between(item["normals"], normals[0].float())[known].median() < 0.5
    assert (item["image"] * 255).round().unique().tolist() == [62.0]


def test_pixels_outside_a_fisheyes_image_circle_do_not_count(root: Path) -> None:
    fisheye = {"model": "OPENCV_FISHEYE", "h": 60, "w": 80, "fx": 45.0, "fy": 45.0, "cx": 39.5, "cy": 29.5}
    fisheye |= {"k1": -0.19, "k2": -0.004, "k3": 0.03, "k4": -0.013}
    (root / "camera.json").write_text(json.dumps(fisheye))
    for number in (3, 12):
        path = str(root / "clip_1" / "depth" / f"{number:06d}.tiff")
        cv2.imwrite(path, np.full((60, 80), 0.05, np.float32))
    item = FolderFrames(root, ["clip_1"], **LAYOUT, normals="none")[0]
    v, u = np.mgrid[0:60, 0:80]
    radius = np.hypot(u - 39.5, v - 29.5) / 45.0
    rim = max(
        t * (1 - 0.19 * t**2 - 0.004 * t**4 + 0.03 * t**6 - 0.013 * t**8) for t in np.linspace(0, 1.5, 9999)
    )
    np.testing.assert_array_equal(item["mask"][0].numpy(), radius <= rim)
    assert bool(item["rays"].isfinite().all())
    assert bool((item["depth"][~item["mask"]] == 0).all())


def test_a_wide_lens_has_no_depth_at_ninety_degrees_and_more(root: Path) -> None:
    wide = {"model": "fisheye", "size": [60, 80], "fx": 20.0, "fy": 20.0, "cx": 39.5, "cy": 29.5}
    (root / "camera.json").write_text(json.dumps(wide))
    for number in (3, 12):
        path = str(root / "clip_1" / "depth" / f"{number:06d}.tiff")
        cv2.imwrite(path, np.full((60, 80), 0.05, np.float32))
    item = FolderFrames(root, ["clip_1"], **LAYOUT)[0]
    v, u = np.mgrid[0:60, 0:80]
    angle = np.hypot(u - 39.5, v - 29.5) / 20.0
    assert not item["mask"][0].numpy()[angle >= np.pi / 2].any()
    assert item["mask"][0].numpy()[angle < np.pi / 2 - 0.1].all()
    assert bool(item["normals"].isfinite().all())


def test_whole_numbers_and_a_largest_depth(root: Path, look: Any) -> None:
    depth, _, mask = look("sphere", CAMERA.rays())
    tenths = torch.where(mask, depth * 10, 0.0)[0, 0].numpy().astype(np.uint16)
    for number in (3, 12):
        cv2.imwrite(str(root / "clip_1" / f"{number}_depth.png"), tenths)
    layout = {**LAYOUT, "depth": "{}_depth.png", "depth_unit": 0.1, "max_depth": float(depth[mask].median())}
    item = FolderFrames(root, ["clip_1:3-3"], **layout, normals="none")[0]
    assert 0.4 < item["mask"].float().mean() / mask.float().mean() < 0.6
    assert (item["depth"] - depth[0])[item["mask"]].abs().max() < 0.11
    assert item["depth"].max() <= layout["max_depth"]


@pytest.mark.parametrize(
    ("layout", "named"),
    [
        ({"image": "rgb/img.jpg"}, ("data.layout.image: ", "{} once", "'rgb/img.jpg'")),
        ({"depth": "{}/{}.tiff"}, ("data.layout.depth: ", "{} once", "'{}/{}.tiff'")),
        ({"image": "rgb/{}.png"}, ("clip_1: ", "frame 3 ", "rgb/0003.png")),
        ({"camera_file": "lens.json"}, ("lens.json: ", "cannot be read")),
    ],
)
def test_a_layout_that_does_not_fit(root: Path, layout: dict[str, Any], named: tuple[str, ...]) -> None:
    with refused(DataError, None, *named):
        FolderFrames(root, ["clip_1"], **{**LAYOUT, **layout})


def test_depth_of_several_channels_is_refused(root: Path) -> None:
    cv2.imwrite(str(root / "clip_1" / "depth" / "000003.tiff"), np.eye(60, 80 * 3).reshape(60, 80, 3))
    with refused(DataError, root / "clip_1" / "depth" / "000003.tiff", "one channel", "got 3 "):
        FolderFrames(root, ["clip_1"], **LAYOUT)


def test_a_folder_without_videos(root: Path) -> None:
    with refused(DataError, f"data.root={root / 'nowhere'}"):
        FolderFrames(root / "nowhere", ["clip_1"], **LAYOUT)


@pytest.mark.parametrize(
    ("image", "there", "first"),
    [
        ("rgb/img_{}.jpg", ["rgb/img_left.jpg", "rgb/img_right.jpg"], "img_left.jpg"),
        ("rgb/img_{}.jpg", ["rgb/photo_1.jpg"], "photo_1.jpg"),
        ("{}.png", ["left.png"], "left.png"),
        ("{}.png", ["0001 (copy).png"], "0001 (copy).png"),
    ],
)
def test_images_whose_names_do_not_fit_are_named(
    root: Path, image: str, there: list[str], first: str
) -> None:
    for number in (3, 12):
        (root / "clip_1" / "rgb" / f"img_{number}.jpg").unlink()
    for name in there:
        (root / "clip_1" / name).touch()
    named = (f"{len(there)} files *{Path(image).suffix} ", f"data.layout.image={image} ", repr(first))
    with refused(DataError, root / "clip_1", *named):
        FolderFrames(root, ["clip_1"], **{**LAYOUT, "image": image})


@pytest.mark.parametrize("entry", ["a/b/c/clip_1", "a/b/c/clip_1:3-12", "a"])
def test_a_video_that_lies_too_deep_is_told_from_one_that_is_missing(root: Path, entry: str) -> None:
    (root / "a/b/c").mkdir(parents=True)
    (root / "clip_1").rename(root / "a/b/c/clip_1")
    image = root / "a/b/c/clip_1/rgb/img_12.jpg"
    about, named = (
        (root / "a", (image, 3)) if entry == "a" else (f"data.root={root}", ("a/b/c/clip_1 ", 4, 3))
    )
    with refused(DataError, about, *named):
        FolderFrames(root, [entry], **LAYOUT)
    without = FolderFrames(root, [], **LAYOUT).without_frames()
    assert all(part in without for part in ("data.layout ", str(image), "3 levels"))
    (root / "a/camera.json").write_bytes((root / "camera.json").read_bytes())
    assert len(FolderFrames(root / "a", ["b/c/clip_1"], **LAYOUT)) == 2
    with refused(DataError, None, "'b/c/d/e'", "data.root"):
        FolderFrames(root, ["b/c/d/e"], **LAYOUT)
