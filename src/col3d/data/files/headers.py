"""Read headers of image files, and check that a file is as long as its header says."""

import warnings
from dataclasses import dataclass
from pathlib import Path

import tifffile
from PIL import Image

from col3d.data.files.decode import (
    JPEG_END,
    PNG_END,
    TAKEN,
    check_page,
    not_eight_bits,
    read_whole,
    several_pictures,
)
from col3d.data.files.tiff import TruncatedError, colour_samples, full_pages, has_eight_bits, open_page
from col3d.errors import DataError, check_disk
from col3d.io.formats import IMAGE_FORMATS, image_format

EIGHT_BITS = ("1", "L", "LA", "P", "PA", "RGB", "RGBA", "RGBX", "CMYK", "YCbCr", "HSV", "LAB")
"""Pillow's modes that become RGB of 8 bits without loss of range."""
PNG_BITS_AT = 24
NUMBERS = {"u": "whole numbers", "i": "whole numbers", "f": "floats", "b": "whole numbers"}
"""Names of numbers by the kind of NumPy's types."""
TAIL = 64
"""Bytes at the end of a file in which its end mark is searched for first."""


@dataclass(frozen=True)
class Header:
    """Content of a file's header.

    Attributes:
        size_hw: height and width in pixels.
        channels: channels of its first picture, transparency included; one for a palette.
        colours: channels without transparency.
        bits: bits of each channel.
        pages: number of pictures in it.
        is_photo: whether it becomes RGB of 8 bits without loss of range; colours of 16 bits are reduced.
        is_palette: whether its numbers are indices of a palette.
        numbers: kind of its numbers, one of `NUMBERS`; other texts where they are no measurement.
    """

    size_hw: tuple[int, int]
    channels: int
    colours: int
    bits: int
    pages: int
    is_photo: bool
    is_palette: bool = False
    numbers: str = "whole numbers"


def read_header(path: Path) -> Header:
    """Read the header of an image file; the file has to be whole as far as its length tells.

    Raises:
        DataError: it is no image of a supported format, or shorter than its header says.
    """
    try:
        name = image_format(path)
        if name not in IMAGE_FORMATS:
            raise DataError(f"{path}: not a readable image ({TAKEN})")
        header = _tiff_header(path) if name == "TIFF" else _other_header(path)
        if not _is_as_long_as_it_says(path, name):
            raise DataError(f"{path}: the file is cut off; copy it again")
        return header
    except DataError:
        raise
    except TruncatedError:
        raise DataError(f"{path}: the file is cut off; copy it again") from None
    except FileNotFoundError:
        raise DataError(f"{path}: no such file") from None
    except Exception as error:  # headers that make no sense fail in many ways
        check_disk(path, error)
        if "truncated" in str(error).lower():
            raise DataError(f"{path}: the file is cut off; copy it again") from None
        reason = " ".join(str(error).replace(str(path), "it").split())[:120] or type(error).__name__
        raise DataError(f"{path}: not a readable image ({reason})") from None


def check_photo(path: Path, header: Header) -> None:
    """Refuse an image that is no picture of 8 bits a channel.

    Raises:
        DataError: names the file, the rule and what was found.
    """
    if not header.is_photo:
        raise not_eight_bits(path, f"{header.channels} of {header.bits} bits")


def check_size(path: Path, size_hw: tuple[int, int], actual_hw: tuple[int, int]) -> None:
    """Refuse an image of another size.

    Raises:
        DataError: names the file and both sizes.
    """
    if actual_hw != size_hw:
        raise DataError(
            f"{path}: expected {size_hw[0]} x {size_hw[1]} pixels, got {actual_hw[0]} x {actual_hw[1]}"
        )


def check_one_page(path: Path, header: Header) -> None:
    """Refuse several pictures where one is expected.

    Raises:
        DataError: names the file and the number of pictures.
    """
    if header.pages > 1:
        raise several_pictures(path, header.pages)


def _other_header(path: Path) -> Header:
    with (
        warnings.catch_warnings(action="ignore"),  # pillow warns, then raises
        Image.open(path, formats=IMAGE_FORMATS) as image,
    ):
        bands, bits = len(image.getbands()), 8
        if image.format == "PNG":
            with path.open("rb") as file:
                bits = file.read(PNG_BITS_AT + 1)[PNG_BITS_AT]
        has_alpha = image.mode[-1] in "Aa" and bands > 1
        return Header(
            (image.height, image.width),
            bands,
            bands - has_alpha,
            bits,
            int(getattr(image, "n_frames", 1)) if image.format != "MPO" else 1,
            image.mode in EIGHT_BITS,
            is_palette=image.mode in ("P", "PA"),
        )


def _tiff_header(path: Path) -> Header:
    with open_page(path) as page:
        check_page(page)
        bits = page.bitspersample  # a list with one for each channel where they differ
        kind = "" if page.dtype is None else page.dtype.kind
        is_palette = page.photometric == tifffile.PHOTOMETRIC.PALETTE
        return Header(
            (page.imagelength, page.imagewidth),
            page.samplesperpixel,
            colour_samples(page),
            bits if isinstance(bits, int) else max(bits),
            len(full_pages(page.parent)),
            has_eight_bits(page),
            is_palette=is_palette,
            numbers="colours of a palette" if is_palette else NUMBERS.get(kind, "other numbers"),
        )


def _is_as_long_as_it_says(path: Path, name: str) -> bool:
    """Whether a PNG or JPEG has its end mark, and a BMP or WebP as many bytes as it announces."""
    size = path.stat().st_size
    with path.open("rb") as file:
        if name in ("BMP", "WEBP"):
            head = file.read(8)
            return int.from_bytes(head[2:6] if name == "BMP" else head[4:8], "little") <= size
        if name == "TIFF":
            return True
        end = PNG_END if name == "PNG" else JPEG_END
        file.seek(max(0, size - TAIL))
        tail = file.read()
        if tail.rstrip(b"\0").endswith(end):
            return True
        file.seek(0)
        if end not in tail and file.read().rfind(end) < 0:
            return False
    if name == "JPEG":  # its end mark may be that of a thumbnail in its header
        read_whole(path)
    return True
