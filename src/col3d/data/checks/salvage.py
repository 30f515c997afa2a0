"""Decode as much as possible of a broken file."""

import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, ImageFile

from col3d.data.files.arrays import is_array, read_array
from col3d.data.files.decode import read_whole
from col3d.errors import DataError
from col3d.io.formats import IMAGE_FORMATS, image_format

QUIETLY = ("PNG", "JPEG")
"""Formats of which Pillow decodes what it can, without a message."""


def read_in_part(path: Path) -> np.ndarray | None:
    """All pixels of a file, or as many as can be decoded of a broken image; None where none can."""
    try:
        return read_array(path) if is_array(path) else read_whole(path)
    except DataError:
        pass
    try:
        name, content = image_format(path), path.read_bytes()
        if name not in IMAGE_FORMATS:
            return None
        with _leniently(), warnings.catch_warnings(action="ignore"):
            return _pillow(content) if name in QUIETLY else _opencv(content)
    except Exception:  # decoders fail in many ways; `read_whole` reports it
        return None


def _pillow(content: bytes) -> np.ndarray:
    with Image.open(io.BytesIO(content), formats=IMAGE_FORMATS) as image:
        return np.asarray(image)


def _opencv(content: bytes) -> np.ndarray:
    pixels = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    if pixels is None:
        raise ValueError("its pixels are broken")
    return pixels if pixels.ndim == 2 else pixels[..., ::-1]


@contextmanager
def _leniently() -> Iterator[None]:
    """Let Pillow decode truncated images inside the block; missing rows stay black."""
    before, ImageFile.LOAD_TRUNCATED_IMAGES = ImageFile.LOAD_TRUNCATED_IMAGES, True
    try:
        yield
    finally:
        ImageFile.LOAD_TRUNCATED_IMAGES = before
