"""What training understands, prediction does: what is no photo in a folder is left out, and said."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image
from refusals import refused

from col3d.data.files.images import image_source
from col3d.errors import DataError

SIZE = (24, 32)


def save(path: Path, kind: str = "rgb") -> Path:
    """A photo, or a map of another type, by what it holds."""
    path.parent.mkdir(parents=True, exist_ok=True)
    values = np.arange(SIZE[0] * SIZE[1]).reshape(SIZE)
    if kind == "rgb":
        cv2.imwrite(str(path), np.dstack([values % 200, values % 91, values % 255]).astype(np.uint8))
    elif kind == "grey of 3":
        cv2.imwrite(str(path), np.dstack([values % 200] * 3).astype(np.uint8))
    else:
        cv2.imwrite(str(path), values.astype({"grey": np.uint8, "16": np.uint16, "float": np.float32}[kind]))
    return path


LAYOUTS: dict[str, tuple[dict[str, str], list[str], str]] = {
    "C3VD": (
        {
            "000{}_color.png": "rgb",
            "000{}_depth.tiff": "16",
            "000{}_normals.tiff": "rgb",
            "000{}_occlusion.png": "grey",
            "000{}_flow.tiff": "rgb",
        },
        ["0000", "0001", "0002"],
        "3 depth, 3 flow, 3 normals, 3 occlusion",
    ),
    "C3VDv2": (
        {"rgb/000{}.png": "rgb", "depth/000{}_depth.tiff": "16", "normals/000{}_normals.tiff": "rgb"},
        ["0000", "0001", "0002"],
        "3 depth, 3 normals",
    ),
    "SimCol3D": (
        {"FrameBuffer_000{}.png": "rgb", "Depth_000{}.png": "16"},
        ["0000", "0001", "0002"],
        "3 depth",
    ),
    "the layout of data=folder": (
        {"000{}.png": "rgb", "000{}_depth.png": "grey"},
        ["0000", "0001", "0002"],
        "3 depth",
    ),
    "words before numbers": (
        {"img{}.jpg": "rgb", "depth{}.png": "16", "mask{}.png": "grey", "Normals_{}.png": "rgb"},
        ["img0", "img1", "img2"],
        "3 depth, 3 masks, 3 normals",
    ),
    "a normal map of the same name": (
        {"a{}.png": "rgb", "a{}_normal.png": "rgb"},
        ["a0", "a1", "a2"],
        "3 normals",
    ),
    "capitals": ({"a{}.png": "rgb", "a{}_DEPTH.png": "rgb"}, ["a0", "a1", "a2"], "3 depth"),
    "camel case": (
        {"view{}Image.png": "rgb", "view{}DepthMap.png": "rgb"},
        ["view0Image", "view1Image", "view2Image"],
        "3 depth",
    ),
    "coverage and labels": (
        {"a{}.png": "rgb", "coverage_{}.png": "rgb", "a{}_seg.png": "grey", "a{}_gt.png": "rgb"},
        ["a0", "a1", "a2"],
        "3 coverage, 3 masks, 3 truth",
    ),
    "16 bits by no name": ({"a{}.png": "rgb", "b{}.png": "16"}, ["a0", "a1", "a2"], "3 of 16 bits a channel"),
    "floats by no name": (
        {"a{}.png": "rgb", "a{}.tiff": "float"},
        ["a0", "a1", "a2"],
        "3 of 32 bits a channel",
    ),
    "depth in a folder of its own": (
        {"a{}.png": "rgb", "depth/a{}.png": "16"},
        ["a0", "a1", "a2"],
        "3 depth",
    ),
    "grey of three channels by no name": (
        {"image_{}.png": "rgb", "aov_image_{}.png": "grey of 3"},
        ["image_0", "image_1", "image_2"],
        "3 grey beside colours",
    ),
    "grey by no name": ({"a{}.png": "rgb", "z{}.png": "grey"}, ["a0", "a1", "a2"], "3 grey beside colours"),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_the_photos_of_a_layout_and_nothing_else(layout: str, tmp_path: Path) -> None:
    files, names, left_out = LAYOUTS[layout]
    for name, kind in files.items():
        for number in range(3):
            save(tmp_path / name.format(number), kind)
    (tmp_path / "pose.txt").touch()
    source = image_source(str(tmp_path))
    shots = list(source)
    assert [shot.name for shot in shots] == names
    assert all(shot.image is not None and shot.image.shape == (*SIZE, 3) for shot in shots)
    note = f"note: {tmp_path}: left out, for they are no photos: {left_out}"
    assert list(source.notes) == ([note] if left_out else [])


@pytest.mark.parametrize(
    "names",
    [
        ["polyp_1.png", "normal_1.png"],
        ["normal_cecum_1.png", "normal_cecum_2.png"],
        ["left_1.png", "right_1.png"],
        ["workflow_1.png", "unmasked_2.png", "deeply_3.png"],
    ],
)
def test_photos_of_other_names_all_count(names: list[str], tmp_path: Path) -> None:
    for name in names:
        save(tmp_path / name)
    source = image_source(str(tmp_path))
    assert sorted(path.name for path in source.paths) == sorted(names)
    assert source.notes == ()


def test_a_black_frame_makes_no_photos_grey(tmp_path: Path) -> None:
    for number in range(3):
        for side in ("left", "right"):
            save(tmp_path / f"{side}_{number}.png")
    cv2.imwrite(str(tmp_path / "left_0.png"), np.zeros((*SIZE, 3), np.uint8))
    assert image_source(str(tmp_path)).count == 6


def test_grey_photos_alone_count(tmp_path: Path) -> None:
    for number in range(3):
        save(tmp_path / f"{number}.png", "grey")
    save(tmp_path / "title.png")
    assert image_source(str(tmp_path)).count == 4


def test_the_folder_of_photos_in_a_folder(tmp_path: Path) -> None:
    for number in range(2):
        for name in ("rgb", "depth", "extra"):
            save(tmp_path / "one" / name / f"img_{number}.png")
        save(tmp_path / "two" / "left_camera" / f"{number}.png")
        save(tmp_path / "two" / "gt" / f"{number}.png", "16")
        save(tmp_path / "many" / "a" / f"{number}.png")
        save(tmp_path / "many" / "b" / f"{number}.png")
    one, two = (image_source(str(tmp_path / name)) for name in ("one", "two"))
    assert {path.parent.name for path in one.paths} == {"rgb"}
    assert one.notes == (
        f"note: the images of {tmp_path / 'one' / 'rgb'} are taken, and not those of depth, extra",
    )
    assert {path.parent.name for path in two.paths} == {"left_camera"}
    with refused(DataError, None, f"{tmp_path / 'many'} holds ", "2 folders", "(a, b)"):
        image_source(str(tmp_path / "many"))


def test_depth_alone_is_refused_unless_a_pattern_asks_for_it(tmp_path: Path) -> None:
    for number in range(2):
        save(tmp_path / f"{number}_depth.png", "grey")
    with refused(DataError, None, str(tmp_path), "2 images", "depth"):
        image_source(str(tmp_path))
    assert image_source(str(tmp_path / "*.png")).count == 2
    save(tmp_path / "0.png")
    both = image_source(str(tmp_path / "*.png"))
    assert [path.name for path in both.paths] == ["0.png"]
    assert "2 depth" in both.notes[0]
    assert image_source(str(tmp_path / "0_depth.png")).count == 1


def test_a_pattern_over_folders_takes_the_photos_in_them(tmp_path: Path) -> None:
    for number in range(2):
        for video, kind in (("a", "rgb"), ("b", "grey")):
            save(tmp_path / video / "rgb" / f"{number}.png", kind)
            save(tmp_path / video / "depth" / f"{number}.png", "16")
            save(tmp_path / video / "other" / f"{number}.png", "16")
    source = image_source(str(tmp_path / "*" / "*" / "*.png"))
    assert [path.parent.name for path in source.paths] == ["rgb"] * 4
    assert [path.parent.parent.name for path in source.paths] == ["a", "a", "b", "b"]
    assert "4 depth, 4 of 16 bits a channel" in source.notes[0]


def test_hidden_files_are_no_images(tmp_path: Path) -> None:
    save(tmp_path / "a.png")
    (tmp_path / "._a.png").write_bytes(b"as macOS leaves them")
    assert [path.name for path in image_source(str(tmp_path)).paths] == ["a.png"]


def test_of_several_pictures_in_a_file_one_is_taken_and_said(tmp_path: Path) -> None:
    save(tmp_path / "a.png")
    pages = [Image.new("RGB", SIZE[::-1], (shade, 0, 0)) for shade in (50, 90, 130)]
    for name in ("b.tif", "c.webp", "d.png"):
        pages[0].save(tmp_path / name, save_all=True, append_images=pages[1:], lossless=True)
    source = image_source(str(tmp_path))
    assert [shot.name for shot in source if shot.image is not None] == ["a", "b", "c", "d"]
    assert source.notes == (
        "note: the first picture is taken of files that hold several: b.tif (3), c.webp (3), d.png (3); as "
        "input=FILE all of one are",
    )


def test_a_broken_photo_is_named_when_its_turn_comes(tmp_path: Path) -> None:
    for name in ("a.png", "b.jpg", "c.png"):
        save(tmp_path / name)
    content = (tmp_path / "b.jpg").read_bytes()
    (tmp_path / "b.jpg").write_bytes(content[: len(content) // 2])
    source = image_source(str(tmp_path))
    assert [shot.fault for shot in source] == [
        "",
        f"{tmp_path / 'b.jpg'}: the file is cut off; copy it again",
        "",
    ]
    assert list(source.sizes()) == [SIZE, SIZE]
