"""What can be wrong with one frame, each broken on purpose."""

import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from spheres import Check, Write, faults, said

from col3d.data.checks import plan_video, thumbnail
from col3d.data.datasets.c3vd import C3VD
from col3d.data.datasets.folder import FolderFrames
from col3d.data.datasets.frame_set import FrameSet, everywhere
from col3d.data.datasets.octagon import octagon_mask
from col3d.data.datasets.simcol3d import SimCol3D
from col3d.data.files.decode import read_whole

Change = Callable[[np.ndarray], np.ndarray]


def path_of(root: Path, kind: str, number: int = 1) -> Path:
    ending = "png" if kind == "color" else "tiff"
    return root / "cecum_t1_a" / f"{number:04d}_{kind}.{ending}"


def change(path: Path, how: Change) -> None:
    pixels = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert cv2.imwrite(str(path), how(pixels))


def test_a_healthy_video_has_no_fault(write_sphere: Write, check: Check) -> None:
    found = check(write_sphere(numbers=range(5)), frames={"current": 5}, poses=True)
    assert found.findings == []
    assert (found.frames, found.in_full, found.duplicates) == (5, 5, 0)
    assert 1 < found.low < 15 < found.high < 60
    assert found.unknown == pytest.approx(1 - octagon_mask((108, 135)).float().mean().item(), abs=1e-6)
    assert (found.outside, found.off_length) == (0, 0)


@pytest.mark.parametrize("kind", ["color", "depth", "normals"])
def test_a_file_that_is_cut_off(write_sphere: Write, check: Check, kind: str) -> None:
    root = write_sphere()
    path = path_of(root, kind)
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    found = check(root)
    assert faults(found) == [("file", 1)]
    assert str(path) in said(found)


@pytest.mark.parametrize("content", [b"", b"<html>Not Found</html>"])
@pytest.mark.parametrize("kind", ["color", "depth", "normals"])
def test_a_file_that_is_no_image(write_sphere: Write, check: Check, kind: str, content: bytes) -> None:
    root = write_sphere()
    path_of(root, kind).write_bytes(content)
    found = check(root)
    assert faults(found) == [("file", 1)]
    assert f"{path_of(root, kind)}: " in said(found)


def test_a_flipped_byte_in_a_png(write_sphere: Write, check: Check) -> None:
    root = write_sphere()
    path = path_of(root, "color")
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0x20
    path.write_bytes(content)
    found = check(root)
    assert faults(found) == [("file", 1)]
    assert f"{path}: cannot be decoded" in said(found)


@pytest.mark.parametrize(
    ("kind", "how", "expected", "came"),
    [
        ("color", lambda pixels: pixels[:54], "108 x 135", "got 54 x 135"),
        ("depth", lambda pixels: pixels[:, :-1], "108 x 135", "got 108 x 134"),
        ("color", lambda pixels: pixels[..., 0], "3 channels of 8 bits", "got 1 channels of 8"),
        ("depth", lambda pixels: (pixels >> 8).astype(np.uint8), "1 channels of 16", "got 1 channels of 8"),
        ("normals", lambda pixels: pixels[..., 1], "3 channels of 16", "got 1 channels of 16"),
    ],
)
def test_a_file_of_another_size_or_type(
    write_sphere: Write, check: Check, kind: str, how: Change, expected: str, came: str
) -> None:
    root = write_sphere()
    change(path_of(root, kind), how)
    found = check(root)
    assert faults(found) == [("file", 1)]
    for named in (f"{path_of(root, kind)}: ", expected, came):
        assert named in said(found)


def test_numbers_with_a_sign_are_no_depth_codes(write_sphere: Write, check: Check) -> None:
    root = write_sphere()
    change(path_of(root, "depth"), lambda pixels: pixels.astype(np.int16))
    found = check(root)
    assert faults(found) == [("file", 1)]
    assert "int16" in said(found)


@pytest.mark.parametrize("code", [0, 65535])
def test_a_frame_without_any_depth(write_sphere: Write, check: Check, code: int) -> None:
    root = write_sphere()
    change(path_of(root, "depth"), lambda pixels: np.full_like(pixels, code))
    found = check(root)
    assert faults(found) == [("depth", 1)]
    assert "0001_depth.tiff: " in said(found)


def test_constant_depth(write_sphere: Write, check: Check) -> None:
    root = write_sphere(numbers=(0,))
    change(path_of(root, "depth", 0), lambda pixels: np.where(pixels > 0, np.uint16(13107), pixels))
    found = check(root)
    assert ("depth", 0) in faults(found)
    assert "got 20.000 mm" in said(found)


def test_depth_outside_the_octagon(write_sphere: Write, check: Check) -> None:
    root = write_sphere()
    outside = ~octagon_mask((108, 135))[0].numpy()
    change(path_of(root, "depth"), lambda pixels: np.where(outside, np.uint16(9000), pixels))
    found = check(root)
    assert faults(found) == [("octagon", 1)]
    assert f"{outside.mean():.1%} of the pixels" in said(found)


def test_a_few_pixels_outside_are_none_of_it(write_sphere: Write, check: Check) -> None:
    root = write_sphere()

    def few(pixels: np.ndarray) -> np.ndarray:
        pixels[0, :20] = 9000  # 0.15 % of the frame, as real frames have 0.04 %
        return pixels

    change(path_of(root, "depth"), few)
    found = check(root)
    assert faults(found) == []
    assert 0 < found.outside < 0.001


def test_normals_of_other_lengths(write_sphere: Write, check: Check) -> None:
    root = write_sphere()

    def shorter(pixels: np.ndarray) -> np.ndarray:
        pixels[40:60] = ((pixels[40:60].astype(np.float64) - 32767.5) * 0.9 + 32767.5).astype(np.uint16)
        return pixels

    change(path_of(root, "normals"), shorter)
    found = check(root)
    assert faults(found) == [("unit length", 1)]
    assert "0001_normals.tiff: " in said(found)


def test_normals_that_are_all_unknown(write_sphere: Write, check: Check) -> None:
    root = write_sphere()
    change(path_of(root, "normals"), np.zeros_like)
    found = check(root)
    assert faults(found) == [("normals", 1)]
    assert "all its pixels are 0" in said(found)


def test_occlusion_is_checked_where_there_is_one(write_sphere: Write, check: Check) -> None:
    root = write_sphere()
    path = root / "cecum_t1_a" / "0001_occlusion.png"
    assert cv2.imwrite(str(path), np.zeros((108, 135), np.uint8))
    assert faults(check(root)) == []
    path.write_bytes(path.read_bytes()[:-4])
    assert faults(check(root)) == [("file", 1)]


def folder_set(root: Path) -> FolderFrames:
    (root / "camera.json").write_text(
        '{"model": "pinhole", "size": [20, 30], "fx": 20, "fy": 20, "cx": 15, "cy": 10}'
    )
    return FolderFrames(root, ["clip"], "{}.png", "{}_depth.tiff", 0.5, 60.0)


def test_depth_is_that_of_the_data_set(tmp_path: Path, write_sphere: Write, frames: C3VD) -> None:
    """Of pixels that are decoded already as of the file that training reads."""
    codes = np.arange(600).reshape(20, 30).astype(np.float32)
    codes[0, :3] = (np.nan, np.inf, -1)
    clip = tmp_path / "own" / "clip"
    clip.mkdir(parents=True)
    assert cv2.imwrite(str(clip / "0000_depth.tiff"), codes)
    assert cv2.imwrite(str(clip / "0000.png"), np.zeros((20, 30, 3), np.uint8))
    whole = np.linspace(0, 65535, 475 * 475).reshape(475, 475).astype(np.uint16)
    video = tmp_path / "sim" / "Frames_S1"
    video.mkdir(parents=True)
    assert cv2.imwrite(str(video / "Depth_0000.png"), whole)
    assert cv2.imwrite(str(video / "FrameBuffer_0000.png"), np.zeros((475, 475, 4), np.uint8))
    root = write_sphere(numbers=(0,))
    change(path_of(root, "depth", 0), lambda pixels: np.where(pixels > 20000, np.uint16(65535), pixels))
    sphere = C3VD(root, ["cecum_t1_a"], camera=frames.camera)
    sets: list[FrameSet] = [folder_set(tmp_path / "own"), SimCol3D(tmp_path / "sim", ["Frames_S1"]), sphere]
    for of_them in sets:
        frame = of_them.frames[0]
        depth, mask = of_them.depth_and_mask(frame, everywhere)
        found = of_them.decoded_depth(read_whole(frame.files["depth"]))
        np.testing.assert_array_equal(found.known, mask[0].numpy())
        np.testing.assert_array_equal(found.mm[found.known], depth[mask].numpy())
        assert 0 < found.known.mean() < 1


def test_thumbnails_show_what_there_is(write_sphere: Write, frames: C3VD) -> None:
    root = write_sphere()
    path_of(root, "normals").unlink()
    path = path_of(root, "color")
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    shutil.copy(path_of(root, "depth", 0), path_of(root, "normals", 2))  # one channel instead of three
    path_of(root, "depth", 2).write_bytes(b"")
    listed = plan_video(frames, "cecum_t1_a", root / "cecum_t1_a").frames
    whole, half, odd = (thumbnail(frames, frame, 60) for frame in listed)
    for values in (whole.image, whole.depth, whole.normals, half.image, half.depth, odd.image, odd.normals):
        assert values is not None
        assert values.shape[:2] == (48, 60)
    assert half.normals is None
    assert odd.depth is None
    assert half.image is not None
    assert half.image[:15].std() > 20
    assert (half.image[-15:] == 0).all()
    assert whole.depth is not None
    assert np.isnan(whole.depth[0, 0])
    assert np.nanmin(whole.depth) > 1
