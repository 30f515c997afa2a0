"""Strict decoding of image files: what a decoder could only salvage is refused."""

import io
import math
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import imagecodecs
import numpy as np
import tifffile
from jaxtyping import UInt8
from kornia_rs.io import decode_image_jpegturbo
from PIL import Image

from col3d.data.files.tiff import (
    TruncatedError,
    full_pages,
    has_eight_bits,
    is_plain_colour,
    open_page,
    read_page,
)
from col3d.errors import DataError, check_disk
from col3d.io.formats import image_format

cv2.utils.logging.setLogLevel(
    cv2.utils.logging.LOG_LEVEL_SILENT
)  # broken files raise errors, which are reported once
cv2.setNumThreads(0)  # a pool of threads does not survive the fork of a loader's workers
PNG_END = b"IEND\xaeB`\x82"
JPEG_END = b"\xff\xd9"
TAKEN = "PNG, JPEG, BMP, TIFF and WebP are taken"
PNG_SIDES_AT = 16
MOST_VALUES = 2**27
"""Most pixels of an image, in TIFF times channels; ninety times those of a frame of C3VD."""
CUT_OFF, BROKEN = "it is truncated", "its data are truncated or damaged"
COLOURS = cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION
Decoder = Callable[[Path], np.ndarray]


def read_whole(path: Path) -> np.ndarray:
    """All pixels of an image, (h, w) or (h, w, c) with red first, of the type that they are stored in.

    The colours of a palette are given in its place; a JPEG always has three channels.

    Raises:
        DataError: names the file, and what is wrong with it.
    """
    with refusals(path):
        return _decoder(path, DECODERS)(path)


def read_rgb8(path: Path, page: int = 0) -> UInt8[np.ndarray, "h w 3"]:
    """Read an image as RGB in 8 bits; its transparency and the rotation in its EXIF data are ignored.

    Args:
        path: the file.
        page: page of a TIFF, one of its `page_numbers`.

    Raises:
        DataError: as `read_whole`, or it is grey of more than 8 bits; colours of 16 bits are reduced.
    """
    with refusals(path):
        decoder = _decoder(path, COLOUR_DECODERS)
        pixels = _colour_tiff(path, page) if page else decoder(path)
        channels = pixels.shape[2] if pixels.ndim == 3 else 1
        if pixels.dtype == np.uint16 and channels >= 3:
            pixels = (pixels >> 8).astype(np.uint8)
        if pixels.dtype != np.uint8:
            raise not_eight_bits(path, f"{8 * pixels.dtype.itemsize} bits")
        if channels >= 3:
            return pixels if channels == 3 else cv2.cvtColor(pixels, cv2.COLOR_RGBA2RGB)
        return cv2.cvtColor(pixels if channels == 1 else pixels[..., 0].copy(), cv2.COLOR_GRAY2RGB)


def several_pictures(path: Path, count: int) -> DataError:
    """Error for a file that holds more than the one picture that is expected."""
    return DataError(f"{path}: expected one picture, got {count} pages or frames; write each alone")


def not_eight_bits(path: Path, actual: str) -> DataError:
    """Error for an image that would lose range in 8 bits, as maps of depth do."""
    return DataError(f"{path}: expected an image of 8 bits a channel, got {actual}")


def check_count(count: int) -> None:
    """Refuse more values than any image has, before memory is allocated for them.

    Raises:
        ValueError: names them.
    """
    if count > MOST_VALUES:
        raise ValueError(f"its header speaks of {count:,} values, and no more than {MOST_VALUES:,} are taken")


def check_page(page: tifffile.TiffPage) -> None:
    """Refuse a page, or a tile of one, with more values than `check_count` takes.

    Raises:
        ValueError: as `check_count`.
    """
    check_count(page.size)
    check_count(math.prod(page.chunks))


@contextmanager
def refusals(path: Path) -> Iterator[None]:
    """Turn any error of a decoder over a file into one error that names the file.

    Raises:
        DataError: names the file, and why it cannot be read.
    """
    try:
        yield
    except DataError:
        raise
    except FileNotFoundError:
        raise DataError(f"{path}: no such file; copy it again") from None
    except OSError as error:
        check_disk(path, error)
        raise _undecodable(path, error.strerror or str(error)) from None
    except Exception as error:  # decoders fail in many ways over bytes that make no sense
        raise _undecodable(path, str(error) or type(error).__name__) from None


def _undecodable(path: Path, reason: str) -> DataError:
    shown = " ".join(reason.replace(str(path), "it").split())[:120]
    return DataError(f"{path}: cannot be decoded ({shown}); copy it again")


def _decoder(path: Path, decoders: dict[str, Decoder]) -> Decoder:
    name = image_format(path)
    if name not in decoders:
        raise ValueError(f"it is no image; {TAKEN}")
    return decoders[name]


def _png(path: Path) -> np.ndarray:
    """Decode a PNG a sixth faster than OpenCV; every checksum has to be right and every row present."""
    content = path.read_bytes()
    width, height = struct.unpack_from(">II", content, PNG_SIDES_AT)
    check_count(width * height)
    pixels: np.ndarray = imagecodecs.png_decode(content)
    if content.rfind(PNG_END) < 0:
        raise TruncatedError(CUT_OFF)
    return pixels


def _jpeg(path: Path) -> np.ndarray:
    """Decode a JPEG by libjpeg-turbo itself, which reports damage that OpenCV and Pillow hide."""
    content = path.read_bytes()
    with Image.open(io.BytesIO(content), formats=["JPEG"]) as image:
        check_count(image.width * image.height)
    try:
        return decode_image_jpegturbo(content, "rgb")
    except Exception:  # its error has no type of its own
        if content.rfind(JPEG_END) < 0:
            raise TruncatedError(CUT_OFF) from None
        return _four_colours(path)


def _four_colours(path: Path) -> np.ndarray:
    """Decode a JPEG of CMYK, which the strict decoder does not support; any other one is broken."""
    with Image.open(path, formats=["JPEG"]) as image:
        if image.mode != "CMYK":
            image.load()  # raises an error if it is truncated
            raise ValueError("its data are damaged")
        return np.asarray(image.convert("RGB"))


def _by_opencv(path: Path) -> np.ndarray:
    pixels = cv2.imdecode(np.frombuffer(path.read_bytes(), np.uint8), cv2.IMREAD_UNCHANGED)
    if pixels is None:
        raise ValueError(BROKEN)
    order = [2, 1, 0, 3][: pixels.shape[2]] if pixels.ndim == 3 else None
    return pixels if order is None else np.ascontiguousarray(pixels[..., order])


def _colour_by_opencv(path: Path) -> np.ndarray:
    return _colours(cv2.imdecode(np.frombuffer(path.read_bytes(), np.uint8), COLOURS))


def _colours(pixels: np.ndarray | None) -> np.ndarray:
    if pixels is None:
        raise ValueError(BROKEN)
    return pixels


def _tiff(path: Path) -> np.ndarray:
    with open_page(path) as page:
        check_page(page)
        if (count := len(full_pages(page.parent))) > 1:
            raise several_pictures(path, count)
        return read_page(path, page)


def _colour_tiff(path: Path, number: int = 0) -> np.ndarray:
    """Decode a page by OpenCV, which converts its colours, unless they are plain."""
    with open_page(path, number) as page:
        check_page(page)
        if not has_eight_bits(page):
            raise not_eight_bits(path, f"{page.samplesperpixel} of {page.bitspersample} bits")
        pixels = read_page(path, page)  # strict, unlike OpenCV
        if is_plain_colour(page):
            return pixels
        pages = cv2.imreadmulti(str(path), page.index, 1, flags=COLOURS)[1]
        return _colours(pages[0] if pages else None)


DECODERS: dict[str, Decoder] = {
    "PNG": _png,
    "JPEG": _jpeg,
    "BMP": _by_opencv,
    "WEBP": _by_opencv,
    "TIFF": _tiff,
}
COLOUR_DECODERS: dict[str, Decoder] = {
    **DECODERS,
    "BMP": _colour_by_opencv,
    "WEBP": _colour_by_opencv,
    "TIFF": _colour_tiff,
}
