"""Read maps of depth from files of any program: images, NumPy arrays and PFM."""

from pathlib import Path

import numpy as np
from jaxtyping import Shaped

from col3d.data.files.arrays import array_header, is_array, read_array
from col3d.data.files.decode import read_whole
from col3d.data.files.headers import NUMBERS, check_one_page, check_size, read_header
from col3d.errors import DataError
from col3d.io.formats import IMAGE_FORMATS, image_format

TAKEN = (
    "taken are PNG, TIFF, BMP, WebP, JPEG, NPY, NPZ of one array and PFM, of whole numbers of 8 to 64 bits "
    "or floats, in one channel, equal channels, or the one that data.layout.depth_channel names"
)
BYTE = 8
Shape = tuple[int, ...]


def check_depth_file(path: Path, size_hw: tuple[int, int], channel: int | None = None) -> int:
    """Refuse, by its header, a file that `read_depth_file` would refuse; channels may differ.

    Args:
        path: the file.
        size_hw: height and width that it must have.
        channel: channel that holds the depth, counted from 0; None where all have to be equal.

    Returns:
        The number of its channels without transparency.

    Raises:
        DataError: names the file, the rule and what was found.
    """
    if is_array(path):
        array = array_header(path)
        check_numbers(path, array.dtype)
        channels = _channels(path, array.shape, size_hw)
    else:
        channels = _image_channels(path, size_hw)
    if channel is not None and channel >= channels:
        raise DataError(
            f"{path}: expected a channel {channel}, which data.layout.depth_channel names, and it has "
            f"{channels}, counted from 0"
        )
    return channels


def read_depth_file(
    path: Path, size_hw: tuple[int, int], channel: int | None = None
) -> Shaped[np.ndarray, "h w"]:
    """Read a map of depth, in the type that it is stored in; arguments as `check_depth_file`.

    Raises:
        DataError: names the file, the rule and what was found.
    """
    if is_array(path):
        check_depth_file(path, size_hw, channel)  # before memory is allocated for its size
        pixels = read_array(path)
    else:
        check_format(path)
        pixels = read_whole(path)
    if (
        pixels.shape == size_hw
        and channel is None
        and pixels.dtype.kind in "uif"
        and pixels.dtype != np.uint8
    ):
        return pixels  # there is nothing else that its header could tell
    channels = check_depth_file(path, size_hw, channel)
    planes = _channels_last(pixels, size_hw)
    if channel is not None:
        return planes[..., channel]
    first, is_float = planes[..., 0], planes.dtype.kind == "f"
    others = (planes[..., place] for place in range(1, min(channels, planes.shape[2])))
    if not all(np.array_equal(first, other, equal_nan=is_float) for other in others):
        raise DataError(
            f"{path}: expected one channel or equal ones, got {channels} that differ; name the one that is "
            "depth, such as data.layout.depth_channel=2 for z of x, y, z"
        )
    return first


def check_numbers(path: Path, dtype: np.dtype) -> None:
    """Refuse types that are neither integers nor floats.

    Raises:
        DataError: names the file and the type.
    """
    if dtype.kind not in "uif":
        raise DataError(f"{path}: expected numbers, got {dtype}; {TAKEN}")


def check_format(path: Path) -> None:
    """Refuse a file that is neither an image nor an array.

    Raises:
        DataError: names the file and what is taken.
    """
    if path.is_file() and image_format(path) not in IMAGE_FORMATS:
        raise DataError(f"{path}: not a map of depth that can be read; {TAKEN}")


def _image_channels(path: Path, size_hw: tuple[int, int]) -> int:
    check_format(path)
    header = read_header(path)
    check_size(path, size_hw, header.size_hw)
    if header.bits < BYTE or header.numbers not in NUMBERS.values():
        actual = f"{header.numbers} of {header.bits} bits"
        raise DataError(f"{path}: expected numbers of 8 bits or more, got {actual}; {TAKEN}")
    check_one_page(path, header)
    return 3 if header.is_palette else header.colours


def _channels(path: Path, shape: Shape, size_hw: tuple[int, int]) -> int:
    """Number of channels of an array (h, w), (h, w, c) or (c, h, w)."""
    if shape == size_hw:
        return 1
    if len(shape) == 3 and size_hw in (shape[:2], shape[1:]):
        return shape[2] if shape[:2] == size_hw else shape[0]
    raise DataError(f"{path}: expected an array of {size_hw[0]} x {size_hw[1]}, got one of shape {shape}")


def _channels_last(pixels: np.ndarray, size_hw: tuple[int, int]) -> np.ndarray:
    """Bring (h, w), (h, w, c) or (c, h, w) to (h, w, c)."""
    if pixels.ndim == 2:
        return pixels[..., None]
    return pixels if pixels.shape[:2] == size_hw else np.moveaxis(pixels, 0, -1)
