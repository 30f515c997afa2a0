"""Strict decoding of pages of TIFF files, of any compression and type of numbers."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
import tifffile

logging.getLogger("tifffile").setLevel(logging.CRITICAL)  # what it warns about is an error here
LZW = 5
BY_OPENCV = ("uint16", "float32")
"""Types that OpenCV decodes strictly, LZW a third faster; it makes up missing data of 8 bits."""
ALPHA = (1, 2)
"""Kinds of extra samples that are transparency."""


class TruncatedError(ValueError):
    """A file is shorter than its header says."""


@contextmanager
def open_page(path: Path, number: int = 0) -> Iterator[tifffile.TiffPage]:
    """Open a page of a file, all of whose data exist.

    Args:
        path: the file.
        number: number of the page, reduced copies of other pages counted.

    Raises:
        TruncatedError: the file is shorter than it says.
        tifffile.TiffFileError: it is no TIFF, or its header makes no sense.
    """
    with tifffile.TiffFile(path) as file:
        page = file.pages[number]
        assert isinstance(page, tifffile.TiffPage)
        _check_directory(file, page)
        _check_segments(page, file.filehandle.size)
        yield page


def full_pages(file: tifffile.TiffFile) -> list[tifffile.TiffPage]:
    """Pages that are not reduced copies of others."""
    pages = [page for page in file.pages if isinstance(page, tifffile.TiffPage)]
    return [page for page in pages if not page.is_reduced] or pages[:1]


def page_numbers(path: Path) -> list[int]:
    """Numbers of the pages that are not reduced copies of others."""
    with tifffile.TiffFile(path) as file:
        return [page.index for page in full_pages(file)]


def read_page(path: Path, page: tifffile.TiffPage) -> np.ndarray:
    """The numbers of a page, (h, w) or (h, w, c), with the file's order of channels.

    Raises:
        ValueError: they cannot be unpacked, or a checksum is wrong.
    """
    if page.compression == LZW and page.index == 0 and str(page.dtype) in BY_OPENCV:
        pixels = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        if pixels is None:
            raise ValueError("its data are damaged")
        if pixels.ndim == 2 or pixels.shape[2] == 3:
            return pixels if pixels.ndim == 2 else pixels[..., ::-1]
    values = page.asarray(maxworkers=1)
    if page.planarconfig == tifffile.PLANARCONFIG.SEPARATE and values.ndim == 3:
        return np.moveaxis(values, 0, -1)
    return values


def is_plain_colour(page: tifffile.TiffPage) -> bool:
    """Whether its numbers are grey or RGB values of 8 bits, without conversion."""
    plain = (tifffile.PHOTOMETRIC.MINISBLACK, tifffile.PHOTOMETRIC.RGB)
    whole_bytes = page.dtype is not None and page.bitspersample == 8 * page.dtype.itemsize
    return page.photometric in plain and whole_bytes and colour_samples(page) in (1, 3)


def has_eight_bits(page: tifffile.TiffPage) -> bool:
    """Whether a page is a picture of 8 bits a channel, or of colours of 16 bits, which can be reduced."""
    if page.dtype is None or page.dtype.kind not in "ub":
        return False
    return page.dtype.itemsize == 1 or (page.dtype.itemsize == 2 and colour_samples(page) >= 3)


def colour_samples(page: tifffile.TiffPage) -> int:
    """Samples of a pixel without transparency, which some programs do not mark as such."""
    if page.photometric == tifffile.PHOTOMETRIC.RGB:
        return min(page.samplesperpixel, 3)
    return page.samplesperpixel - sum(int(kind) in ALPHA for kind in page.extrasamples)


def _check_directory(file: tifffile.TiffFile, page: tifffile.TiffPage) -> None:
    """Check that a page's tags, and the offset of the next page after them, are complete."""
    count, tag, place = (8, 20, 8) if file.is_bigtiff else (2, 12, 4)
    file.filehandle.seek(page.offset)
    order: Literal["little", "big"] = "little" if file.byteorder == "<" else "big"
    tags = int.from_bytes(file.filehandle.read(count), order)
    if page.offset + count + tag * tags + place > file.filehandle.size:
        raise TruncatedError("it is truncated")


def _check_segments(page: tifffile.TiffPage, size: int) -> None:
    ends = [start + count for start, count in zip(page.dataoffsets, page.databytecounts, strict=True)]
    if not ends or min(page.databytecounts) == 0 or max(ends) > size:
        raise TruncatedError("it is truncated")
