"""Decoding files strictly: what is not whole to the last byte is refused."""

import io
import struct
import warnings
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, ImageFile, UnidentifiedImageError
from PIL.TiffImagePlugin import TiffImageFile

from col3d.checks import DataError
from col3d.formats import IMAGE_FORMATS

PNG = b"\x89PNG\r\n\x1a\n"
PNG_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
"""By the kind of colour."""
TIFF = (b"II*\0", b"MM\0*")
COMPRESSION, STRIPS, STRIP_BYTES = 259, 273, 279
DEFLATE = (8, 32946)


def read_whole(path: Path) -> np.ndarray:
    """All pixels of an image, (h, w) or (h, w, c) with red first.

    Some versions of OpenCV give back half of a broken PNG without a word; here each chunk's checksum has to
    be right and every row to be there. TIFF has no checksums: strips have to be there, and to be unpacked
    where they are packed.

    Raises:
        DataError: names the file and what is wrong with it.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror}); copy it again") from None
    try:
        with warnings.catch_warnings(action="ignore"):
            return _png(content) if content.startswith(PNG) else _other(content)
    except Exception as error:  # a broken file may raise whatever its decoder thinks of
        what = "it is no image" if isinstance(error, UnidentifiedImageError) else error
        raise DataError(f"{path}: cannot be decoded ({what}); copy it again") from None


def read_in_part(path: Path) -> np.ndarray | None:
    """As `read_whole`, with whatever there is of a broken image; None where that is nothing."""
    try:
        content = path.read_bytes()
        with _leniently(), warnings.catch_warnings(action="ignore"):
            return _pixels_of_png(content) if content.startswith(PNG) else _pixels_of_other(content)
    except Exception:  # as in `read_whole`, where it is told
        return None


def _png(content: bytes) -> np.ndarray:
    Image.open(io.BytesIO(content), formats=IMAGE_FORMATS).verify()
    pixels = _pixels_of_png(content)
    if not pixels[-1].any():
        _check_rows(content)
    return pixels


def _pixels_of_png(content: bytes) -> np.ndarray:
    with Image.open(io.BytesIO(content), formats=IMAGE_FORMATS) as image:
        return np.asarray(image)


def _check_rows(content: bytes) -> None:
    """Pillow leaves rows black that are not there; the last one was, which it may be of itself."""
    width, height, bits, kind, _, _, interlaced = struct.unpack_from(">IIBBBBB", content, len(PNG) + 8)
    row = 1 + (width * bits * PNG_CHANNELS[kind] + 7) // 8
    found = len(zlib.decompress(b"".join(_data_chunks(content))))
    if found < height * row and not interlaced:
        raise ValueError(f"{found // row} of {height} rows are there")


def _data_chunks(content: bytes) -> Iterator[bytes]:
    at = len(PNG)
    while at < len(content):
        length, name = struct.unpack_from(">I4s", content, at)
        if name == b"IDAT":
            yield content[at + 8 : at + 8 + length]
        at += length + 12


def _other(content: bytes) -> np.ndarray:
    if content.startswith(TIFF):
        _check_deflated(content)
    return _pixels_of_other(content)


def _check_deflated(content: bytes) -> None:
    """The only strips of a TIFF with a checksum, at which libtiff does not look."""
    with Image.open(io.BytesIO(content), formats=IMAGE_FORMATS) as image:
        assert isinstance(image, TiffImageFile)
        tags = image.tag_v2
        packed = tags.get(COMPRESSION, 1) in DEFLATE
        strips = list(zip(tags.get(STRIPS, ()), tags.get(STRIP_BYTES, ()), strict=True)) if packed else []
    for start, count in strips:
        zlib.decompress(content[start : start + count])


def _pixels_of_other(content: bytes) -> np.ndarray:
    with _silence():
        pixels = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    if pixels is None:
        raise ValueError("its pixels are broken")
    return pixels if pixels.ndim == 2 else pixels[..., ::-1]


@contextmanager
def _silence() -> Iterator[None]:
    """What is broken is said once, by us."""
    before = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        cv2.utils.logging.setLogLevel(before)


@contextmanager
def _leniently() -> Iterator[None]:
    """Rows that are missing stay black."""
    before, ImageFile.LOAD_TRUNCATED_IMAGES = ImageFile.LOAD_TRUNCATED_IMAGES, True
    try:
        yield
    finally:
        ImageFile.LOAD_TRUNCATED_IMAGES = before
