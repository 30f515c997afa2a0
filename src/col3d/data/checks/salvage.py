"""Whatever can be decoded of a file, however broken it is."""

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
"""Of which Pillow makes what it can, and says nothing."""


def read_in_part(path: Path) -> np.ndarray | None:
    """All pixels of a file, or whatever there is of a broken image; None where that is nothing."""
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
    except Exception:  # as in `read_whole`, where it is told
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
    """Rows that are missing stay black."""
    before, ImageFile.LOAD_TRUNCATED_IMAGES = ImageFile.LOAD_TRUNCATED_IMAGES, True
    try:
        yield
    finally:
        ImageFile.LOAD_TRUNCATED_IMAGES = before
