"""Reading of uploads, which are checked by their header before any pixel is decoded."""

import warnings
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8
from PIL import Image

from col3d.data.datasets.c3vd import MAX_DEPTH
from col3d.data.datasets.release import FULL_CODE
from col3d.data.files.arrays import is_array
from col3d.data.files.depth_files import read_depth_file
from col3d.data.files.headers import read_header
from col3d.data.files.images import IMAGE_ENDINGS, check_sides, read_image
from col3d.data.files.video_files import Pictures, VideoFile
from col3d.errors import DataError
from col3d.io.formats import IMAGE_FORMATS, image_format

MOST_BYTES, MOST_PIXELS = 50_000_000, 25_000_000
MOST_SECONDS, MOST_FRAMES = 10, 150
MOST_SIDE = 1350
"""Largest displayed side in pixels, which is that of C3VD's frames."""


@dataclass(frozen=True)
class Clip:
    """A short video: RGB frames of one size, and their number per second."""

    frames: list[UInt8[np.ndarray, "h w 3"]]
    fps: float


@dataclass(frozen=True)
class Truth:
    """True depth in mm, and where it is known."""

    depth: Float[np.ndarray, "h w"]
    mask: Bool[np.ndarray, "h w"]


def is_video(path: Path) -> bool:
    """Whether a file is read as a video, because it has neither the first bytes nor the name of an image."""
    return image_format(path) not in IMAGE_FORMATS and path.suffix.lower() not in IMAGE_ENDINGS


def read_photo(path: Path) -> UInt8[np.ndarray, "h w 3"]:
    """Read an uploaded image as RGB.

    Raises:
        DataError: it is no image, truncated or too large; the message gives the file's own name.
    """
    _check_image(path)
    try:
        return read_image(path)
    except DataError as error:
        raise DataError(str(error).replace(str(path), path.name)) from None


def pictures_in(path: Path) -> int:
    """Return the number of pictures in an image file, of which the first is read."""
    return read_header(path).pages


def read_clip(path: Path, most_side: int) -> Clip:
    """Read an uploaded video, reduced to sides of at most `most_side` pixels.

    Raises:
        DataError: it cannot be decoded, or is too long or too large.
    """
    _check_bytes(path)
    try:
        video = Pictures(path) if image_format(path) == "GIF" else VideoFile(path)
    except DataError as error:
        raise DataError(str(error).replace(str(path), path.name)) from None
    height, width = video.size_hw
    if width * height > MOST_PIXELS:
        raise DataError(_too_many_pixels(path, height, width))
    fps = video.fps or 15.0
    most = min(MOST_FRAMES, int(MOST_SECONDS * fps))
    frames: list[np.ndarray] = []
    for shot in video:
        if shot.image is None:
            continue
        if len(frames) == most:
            raise DataError(
                f"{path.name}: longer than {MOST_SECONDS} seconds or {MOST_FRAMES} frames; cut it first, or "
                "use col3d predict, which takes videos of any length"
            )
        frames.append(fitted(shot.image, most_side))
    if not frames:
        raise DataError(f"{path.name}: no frame of it can be decoded")
    return Clip(frames, fps)


def read_truth(path: Path, size_hw: tuple[int, int]) -> Truth:
    """Read an uploaded depth file of C3VD: codes of 16 bits, where 65535 is 100 mm.

    Args:
        path: path of an image or an array; see `col3d.data.files.depth_files`.
        size_hw: size of the image that it belongs to.

    Raises:
        DataError: it is no such file, or of another size.
    """
    _check_bytes(path) if is_array(path) else _check_image(path)
    try:
        codes = read_depth_file(path, size_hw)
    except DataError as error:
        raise DataError(f"true depth: {str(error).replace(str(path), path.name)}") from None
    if codes.dtype != np.uint16:
        raise DataError(
            f"true depth: {path.name}: expected 16 bits a pixel as C3VD has them, got {codes.dtype}"
        )
    mask = (codes > 0) & (codes < FULL_CODE)
    return Truth(codes.astype(np.float32) * np.float32(MAX_DEPTH / FULL_CODE), mask)


def fitted(pixels: np.ndarray, most_side: int = MOST_SIDE, exact: bool = False) -> np.ndarray:
    """Reduce a picture to sides of at most `most_side`; `exact` takes nearest pixels instead of means."""
    height, width = pixels.shape[:2]
    share = most_side / max(height, width)
    if share >= 1:
        return pixels
    method = cv2.INTER_NEAREST if exact else cv2.INTER_AREA
    return cv2.resize(
        pixels, (max(1, round(width * share)), max(1, round(height * share))), interpolation=method
    )


def _check_image(path: Path) -> None:
    """Refuse an image by the size of the file or its header."""
    _check_bytes(path)
    try:
        with warnings.catch_warnings(action="ignore"), Image.open(path, formats=IMAGE_FORMATS) as image:
            width, height = image.size
    except Image.DecompressionBombError:
        raise DataError(
            f"{path.name}: more than {MOST_PIXELS / 1e6:.0f} megapixels; make it smaller"
        ) from None
    except Exception:  # invalid headers fail in many ways
        raise DataError(f"{path.name}: not an image that can be read") from None
    if width * height > MOST_PIXELS:
        raise DataError(_too_many_pixels(path, height, width))
    check_sides(Path(path.name), height, width)


def _check_bytes(path: Path) -> None:
    size = path.stat().st_size
    if size > MOST_BYTES:
        raise DataError(f"{path.name}: {size / 1e6:.0f} MB; at most {MOST_BYTES / 1e6:.0f} MB are taken")


def _too_many_pixels(path: Path, height: int, width: int) -> str:
    return (
        f"{path.name}: {height} x {width} pixels are {height * width / 1e6:.0f} megapixels; at most "
        f"{MOST_PIXELS / 1e6:.0f} are taken"
    )
