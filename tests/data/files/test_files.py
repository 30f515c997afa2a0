"""Image files: what is not whole, or not what it should be, is one error that names the file."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image
from refusals import refused

from col3d.data.datasets.c3vd import C3VD
from col3d.data.files.image_files import check_header, read_grey, read_rgb
from col3d.errors import DataError


def halve(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def cut_tail(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-5])


def drop_pixels(path: Path) -> None:
    """The header says more than the file holds, as after a copy that broke off."""
    content = path.read_bytes()
    path.write_bytes(content[:8] if path.suffix == ".tiff" else content[:40])


def as_type(dtype: type, channels: int, size_hw: tuple[int, int] = (108, 135)) -> Callable[[Path], None]:
    shape = size_hw if channels == 1 else (*size_hw, channels)
    return lambda path: (None, cv2.imwrite(str(path), np.ones(shape, dtype)))[0]


BAD: list[Any] = [
    *(
        (kind, damage)
        for kind in ("color.png", "depth.tiff", "normals.tiff")
        for damage in (
            halve,
            drop_pixels,
            Path.unlink,
            lambda path: path.write_bytes(b""),
            lambda path: path.write_bytes(b"not an image" * 99),
        )
    ),
    ("color.png", cut_tail),
    ("color.png", as_type(np.uint8, 1)),
    ("color.png", as_type(np.uint8, 4)),
    ("color.png", as_type(np.uint8, 3, (135, 108))),
    ("depth.tiff", as_type(np.uint8, 1)),
    ("depth.tiff", as_type(np.float32, 1)),
    ("depth.tiff", as_type(np.uint16, 3)),
    ("depth.tiff", as_type(np.uint16, 1, (107, 135))),
    ("normals.tiff", as_type(np.uint8, 3)),
    ("normals.tiff", as_type(np.uint16, 1)),
    ("normals.tiff", as_type(np.uint16, 3, (54, 67))),
]


@pytest.mark.parametrize(("kind", "damage"), BAD)
def test_a_bad_file_is_named_when_the_set_is_built(
    write_video, lens, kind: str, damage: Callable[[Path], None]
) -> None:
    root = write_video(numbers=range(6))
    damage(root / "cecum_t1_a" / f"0005_{kind}")
    with refused(DataError, None, "cecum_t1_a", f"0005_{kind}"):
        C3VD(root, ["cecum_t1_a"], camera=lens)


@pytest.mark.parametrize("lost", [1, 500, 20000])
def test_a_tiff_whose_header_is_whole_and_whose_pixels_are_not(write_video, lens, lost: int) -> None:
    """Writers other than OpenCV put the header first, and a copy that broke off still opens."""
    root = write_video()
    path = root / "cecum_t1_a" / "0002_depth.tiff"
    Image.fromarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED)).save(path)
    assert len(C3VD(root, ["cecum_t1_a"], camera=lens)) == 3
    path.write_bytes(path.read_bytes()[:-lost])
    with refused(DataError, path, "cut off"):
        C3VD(root, ["cecum_t1_a"], camera=lens)


@pytest.mark.parametrize("kind", ["color.png", "depth.tiff"])
def test_a_file_that_spoils_later_is_named_when_it_is_read(write_video, lens, kind: str) -> None:
    root = write_video()
    frames = C3VD(root, ["cecum_t1_a"], camera=lens)
    path = root / "cecum_t1_a" / f"0002_{kind}"
    content = bytearray(path.read_bytes())
    content[len(content) // 3 : len(content) // 2] = bytes(len(content) // 2 - len(content) // 3)
    path.write_bytes(content)
    with refused(DataError, path, "decoded"):
        frames[2]
    path.unlink()
    with refused(DataError, path, "no such file"):
        frames[2]


def test_sixteen_bit_colour_is_named(tmp_path: Path) -> None:
    path = tmp_path / "0_color.png"
    cv2.imwrite(str(path), np.ones((4, 5, 3), np.uint16))
    with refused(DataError, path, "3 channels of 8 bits", "3 channels of 16"):
        check_header(path, (4, 5), 3, 8)
    with refused(DataError, path, "uint8 of shape (4, 5, 3)", "got uint16"):
        read_rgb(path, (4, 5), np.uint8)
    with refused(DataError, path, "uint16 of shape (4, 5)"):
        read_grey(path, (4, 5), np.uint16)
