"""Reading image files, each checked by its header before training and in full when it is read."""

import logging
import warnings
from pathlib import Path

import cv2
import imagecodecs
import numpy as np
import tifffile
from PIL import Image, UnidentifiedImageError
from PIL.TiffImagePlugin import TiffImageFile

from col3d.checks import DataError
from col3d.formats import IMAGE_FORMATS

cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)  # each TIFF of C3VD has a harmless tag
logging.getLogger("tifffile").setLevel(logging.CRITICAL)  # what it warns of, the decoder says
cv2.setNumThreads(0)  # a pool of threads does not survive the fork of a loader's workers
PNG_END = b"IEND\xaeB`\x82"
PNG_BITS_AT = 24


def check_header(path: Path, size_hw: tuple[int, int], channels: int | None, bits: int | None) -> None:
    """Refuse a file whose header or length shows that it is not the complete image it should be.

    Args:
        path: of the file.
        size_hw: that it must have.
        channels: likewise; None where any number will do.
        bits: of each channel, likewise.

    Raises:
        DataError: names the file, the rule and what came.
    """
    try:
        with (
            warnings.catch_warnings(action="ignore"),  # pillow warns, then raises
            Image.open(path, formats=IMAGE_FORMATS) as image,
        ):
            found_hw, found = (image.height, image.width), _channels_and_bits(image, path)
            end = _data_end(image)
    except (UnidentifiedImageError, OSError, SyntaxError, ValueError) as error:
        raise DataError(f"{path}: not a readable image ({error})") from None
    if found_hw != size_hw:
        raise DataError(
            f"{path}: expected {size_hw[0]} x {size_hw[1]} pixels, got {found_hw[0]} x {found_hw[1]}"
        )
    if channels not in (None, found[0]) or bits not in (None, found[1]):
        raise DataError(
            f"{path}: expected {channels} channels of {bits} bits, got {found[0]} channels of {found[1]} bits"
        )
    if path.stat().st_size < end or (path.suffix == ".png" and not _ends_as_png(path)):
        raise DataError(f"{path}: the file is cut off; copy it again")


def _channels_and_bits(image: Image.Image, path: Path) -> tuple[int, int]:
    if isinstance(image, TiffImageFile):
        bits = image.tag_v2.get(258, (1,))
        return image.tag_v2.get(277, 1), max(bits if isinstance(bits, tuple) else (bits,))
    with path.open("rb") as file:
        return len(image.getbands()), file.read(PNG_BITS_AT + 1)[PNG_BITS_AT]


def _data_end(image: Image.Image) -> int:
    """Position behind the last byte of pixel data that a TIFF's header announces; 0 for other formats."""
    tags = image.tag_v2 if isinstance(image, TiffImageFile) else {}
    return max(
        (start + count for start, count in zip(tags.get(273, ()), tags.get(279, ()), strict=False)), default=0
    )


def _ends_as_png(path: Path) -> bool:
    with path.open("rb") as file:
        file.seek(0, 2)
        file.seek(max(0, file.tell() - len(PNG_END)))
        return file.read() == PNG_END


def read_rgb(path: Path, size_hw: tuple[int, int], dtype: type[np.generic]) -> np.ndarray:
    """An image of three channels as (h, w, 3); of a TIFF without compression a view to read only.

    Raises:
        DataError: the file cannot be decoded, or has another size or type.
    """
    if path.suffix == ".png":
        return _checked(path, _decoded_png(path), (*size_hw, 3), dtype)
    mapped = _mapped(path, (*size_hw, 3), dtype)
    return _read(path, (*size_hw, 3), dtype)[..., ::-1] if mapped is None else mapped


def read_grey(path: Path, size_hw: tuple[int, int], dtype: type[np.generic]) -> np.ndarray:
    """An image of one channel as (h, w); errors as in `read_rgb`."""
    return _read(path, size_hw, dtype)


def read_colour(path: Path, size_hw: tuple[int, int]) -> np.ndarray:
    """Any image as RGB (h, w, 3) in 8 bits; what is transparent or of more bits loses that.

    Raises:
        DataError: the file cannot be decoded, or has another size.
    """
    pixels = _decoded(path, cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION)
    if pixels.shape != (*size_hw, 3):
        raise DataError(f"{path}: expected {size_hw[0]} x {size_hw[1]} pixels, got {pixels.shape[:2]}")
    return pixels


def read_any(path: Path, size_hw: tuple[int, int]) -> np.ndarray:
    """An image of one channel (h, w), of whatever type its values are.

    Raises:
        DataError: the file cannot be decoded, or has another size.
    """
    pixels = _decoded(path)
    if pixels.shape != size_hw:
        raise DataError(f"{path}: expected one channel of shape {size_hw}, got {pixels.shape}")
    return pixels


def _read(path: Path, shape: tuple[int, ...], dtype: type[np.generic]) -> np.ndarray:
    return _checked(path, _decoded(path), shape, dtype)


def _checked(path: Path, pixels: np.ndarray, shape: tuple[int, ...], dtype: type[np.generic]) -> np.ndarray:
    if pixels.shape != shape or pixels.dtype != dtype:
        raise DataError(
            f"{path}: expected {np.dtype(dtype)} of shape {shape}, got {pixels.dtype} of {pixels.shape}"
        )
    return pixels


def _decoded_png(path: Path) -> np.ndarray:
    """Red first; a sixth faster than OpenCV."""
    try:
        pixels: np.ndarray = imagecodecs.png_decode(path.read_bytes())
    except (OSError, RuntimeError, ValueError):
        raise _undecodable(path) from None
    return pixels


def _undecodable(path: Path) -> DataError:
    return DataError(f"{path}: {'cannot be decoded' if path.exists() else 'no such file'}; copy it again")


def _decoded(path: Path, flags: int = cv2.IMREAD_UNCHANGED) -> np.ndarray:
    pixels = cv2.imread(str(path), flags)
    if pixels is None:
        raise _undecodable(path)
    return pixels


def _mapped(path: Path, shape: tuple[int, ...], dtype: type[np.generic]) -> np.ndarray | None:
    """The pixels of a TIFF where they lie in the file as they are; None of any other file."""
    if path.suffix not in (".tif", ".tiff"):
        return None
    try:
        pixels = np.asarray(tifffile.memmap(path, mode="r"))
    except (OSError, ValueError, IndexError, tifffile.TiffFileError):
        return None  # compressed or broken, which the decoder tells apart
    return pixels if pixels.shape == shape and pixels.dtype == dtype else None
