"""Image files of a data set: checked by their headers before training, and in full when they are read."""

from pathlib import Path

import numpy as np
import tifffile

from col3d.data.files.decode import read_rgb8, read_whole
from col3d.data.files.headers import check_one_page, check_photo, check_size, read_header
from col3d.errors import DataError


def check_header(path: Path, size_hw: tuple[int, int], channels: int | None, bits: int | None) -> None:
    """Refuse a file whose header or length shows that it is not the complete image it should be.

    Args:
        path: the file.
        size_hw: height and width that it must have.
        channels: channels that it must have; None for any picture of 8 bits a channel.
        bits: bits that each channel must have; None for any number.

    Raises:
        DataError: names the file, the rule and what was found.
    """
    header = read_header(path)
    check_size(path, size_hw, header.size_hw)
    if channels is None:
        check_photo(path, header)
    elif channels != header.channels or bits not in (None, header.bits):
        raise DataError(
            f"{path}: expected {channels} channels of {bits} bits, got {header.channels} channels of "
            f"{header.bits} bits"
        )
    check_one_page(path, header)


def read_rgb(path: Path, size_hw: tuple[int, int], dtype: type[np.generic]) -> np.ndarray:
    """Read an image of three channels as (h, w, 3); for an uncompressed TIFF, a read-only view.

    Raises:
        DataError: the file cannot be decoded, or has another size or type.
    """
    mapped = _mapped(path, (*size_hw, 3), dtype)
    return _read(path, (*size_hw, 3), dtype) if mapped is None else mapped


def read_grey(path: Path, size_hw: tuple[int, int], dtype: type[np.generic]) -> np.ndarray:
    """Read an image of one channel as (h, w); errors as in `read_rgb`."""
    return _read(path, size_hw, dtype)


def read_colour(path: Path, size_hw: tuple[int, int]) -> np.ndarray:
    """Read any image as RGB (h, w, 3) in 8 bits, without transparency; colours of 16 bits are reduced.

    Raises:
        DataError: the file cannot be decoded, or has another size.
    """
    pixels = read_rgb8(path)
    height, width, _ = pixels.shape
    check_size(path, size_hw, (height, width))
    return pixels


def _read(path: Path, shape: tuple[int, ...], dtype: type[np.generic]) -> np.ndarray:
    pixels = read_whole(path)
    if pixels.shape != shape or pixels.dtype != dtype:
        raise DataError(
            f"{path}: expected {np.dtype(dtype)} of shape {shape}, got {pixels.dtype} of {pixels.shape}"
        )
    return pixels


def _mapped(path: Path, shape: tuple[int, ...], dtype: type[np.generic]) -> np.ndarray | None:
    """Memory map of the pixels of an uncompressed TIFF; None of any other file."""
    if path.suffix not in (".tif", ".tiff"):
        return None
    try:
        pixels = np.asarray(tifffile.memmap(path, mode="r"))
    except (OSError, ValueError, IndexError, tifffile.TiffFileError):
        return None  # compressed or broken; the decoder tells which
    return pixels if pixels.shape == shape and pixels.dtype == dtype else None
