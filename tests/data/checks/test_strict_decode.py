"""Files are read to the last byte, or refused."""

import io
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image
from refusals import refused

from col3d.data.checks.salvage import read_in_part
from col3d.data.files.decode import read_whole
from col3d.errors import DataError

PIXELS = np.random.default_rng(0).integers(0, 256, (90, 110, 3), np.uint8)
CODES = np.arange(40 * 50, dtype=np.uint16).reshape(40, 50) * 30


def png(path: Path) -> Path:
    assert cv2.imwrite(str(path), PIXELS[..., ::-1])
    return path


def tiff(path: Path, compression: int = 1, pixels: np.ndarray = CODES) -> Path:
    assert cv2.imwrite(str(path), pixels, (cv2.IMWRITE_TIFF_COMPRESSION, compression))
    return path


def test_whole_files_come_red_first(tmp_path: Path) -> None:
    np.testing.assert_array_equal(read_whole(png(tmp_path / "a.png")), PIXELS)
    np.testing.assert_array_equal(read_whole(tiff(tmp_path / "a.tiff")), CODES)
    colours = np.stack([CODES, CODES + 1, CODES + 2], axis=-1)
    written = tiff(tmp_path / "b.tiff", pixels=np.ascontiguousarray(colours[..., ::-1]))
    np.testing.assert_array_equal(read_whole(written), colours)
    assert cv2.imwrite(str(tmp_path / "c.png"), CODES)
    np.testing.assert_array_equal(read_whole(tmp_path / "c.png"), CODES)


def cut(content: bytes) -> bytes:
    return content[: len(content) * 2 // 3]


def flip_middle(content: bytes) -> bytes:
    middle = len(content) // 2
    return content[:middle] + bytes([content[middle] ^ 0x10]) + content[middle + 1 :]


def flip_checksum(content: bytes) -> bytes:
    return content[:-14] + bytes([content[-14] ^ 1]) + content[-13:]


def lose_rows(content: bytes) -> bytes:
    """Half of the pixels, packed anew: every checksum right."""
    rows = b"".join(b"\0" + row.tobytes() for row in PIXELS[:45])
    data = zlib.compress(rows)
    chunk = b"IDAT" + data
    head = content[: content.index(b"IDAT") - 4]
    return head + struct.pack(">I", len(data)) + chunk + struct.pack(">I", zlib.crc32(chunk)) + content[-12:]


@pytest.mark.parametrize("damage", [cut, flip_middle, flip_checksum, lose_rows])
def test_a_damaged_png_is_refused(tmp_path: Path, damage: Callable[[bytes], bytes]) -> None:
    path = png(tmp_path / "a.png")
    path.write_bytes(damage(path.read_bytes()))
    with refused(DataError, path, "decoded ("):
        read_whole(path)


def cut_strips(content: bytes) -> bytes:
    """The directory stays where it is; its last strip begins where too few bytes are left."""
    with Image.open(io.BytesIO(content)) as image:
        last = image.tag_v2[273][-1] if isinstance(image.tag_v2[273], tuple) else image.tag_v2[273]
    return content.replace(struct.pack("<I", last), struct.pack("<I", len(content) - 4), 1)


@pytest.mark.parametrize("damage", [cut, cut_strips])
@pytest.mark.parametrize("compression", [1, 5, 8])
def test_a_tiff_that_is_not_complete_is_refused(
    tmp_path: Path, compression: int, damage: Callable[[bytes], bytes]
) -> None:
    path = tiff(tmp_path / "a.tiff", compression)
    path.write_bytes(damage(path.read_bytes()))
    with refused(DataError, path, "decoded ("):
        read_whole(path)


@pytest.mark.parametrize("at", [11, 24, 71, 144])
def test_a_flipped_byte_in_a_deflated_tiff_is_refused(tmp_path: Path, at: int) -> None:
    """At places where OpenCV 5 gives back wrong pixels without a word."""
    path = tiff(tmp_path / "a.tiff", 8)
    content = bytearray(path.read_bytes())
    with Image.open(path) as image:
        content[image.tag_v2[273][0] + at] ^= 1
    path.write_bytes(content)
    with refused(DataError, path, "decoded ("):
        read_whole(path)


@pytest.mark.parametrize("content", [b"", b"no image", b"II*\0", b"\x89PNG\r\n\x1a\n"])
def test_what_is_no_image_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.png"
    path.write_bytes(content)
    with refused(DataError, path, "decoded ("):
        read_whole(path)
    assert read_in_part(path) is None


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with refused(DataError, tmp_path / "a.png", "no such file"):
        read_whole(tmp_path / "a.png")
    assert read_in_part(tmp_path / "a.png") is None


def test_half_of_a_broken_picture_can_be_shown(tmp_path: Path) -> None:
    path = png(tmp_path / "a.png")
    path.write_bytes(cut(path.read_bytes()))
    found = read_in_part(path)
    assert found is not None
    np.testing.assert_array_equal(found[:20], PIXELS[:20])
    with refused(DataError, path):
        read_whole(path)  # leniency ended with the other call
