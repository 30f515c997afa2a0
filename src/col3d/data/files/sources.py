"""Interface of image sources: images one after the other, none kept in memory."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from col3d.data.files.decode import read_rgb8
from col3d.data.files.headers import check_photo, read_header
from col3d.errors import DataError

LONGEST = 20
"""Largest ratio of the sides of an image: a longer one would be a line."""


@dataclass(frozen=True)
class SourceImage:
    """One image of a source.

    Attributes:
        name: name for output files, unique in the source.
        number: number of the frame, or index of the image.
        image: RGB (h, w, 3) in 8 bits; None where it cannot be read.
        fault: what is wrong with it, or empty.
    """

    name: str
    number: int
    image: np.ndarray | None
    fault: str = ""


class ImageSource(ABC):
    """Images one after the other, none kept in memory.

    Attributes:
        name: name of the source.
        is_video: whether each image follows the one before in time.
        fps: frames a second; None where it is not known.
        count: number of images, as far as it is known before they are read.
        paths: paths of the files that are read.
        notes: lines on files that are left out.
    """

    name: str
    is_video: bool
    fps: float | None = None
    count: int
    paths: tuple[Path, ...]
    notes: tuple[str, ...] = ()

    @abstractmethod
    def __iter__(self) -> Iterator[SourceImage]:
        """Yield each image, or what is wrong with it."""

    @abstractmethod
    def sizes(self) -> Iterator[tuple[int, int]]:
        """Height and width of images by their headers, read lazily; broken images are skipped."""


def read_image(path: Path) -> np.ndarray:
    """Read any whole image file as RGB (h, w, 3) in 8 bits; the rotation in its EXIF data is ignored.

    Raises:
        DataError: it is no image, is damaged, or is grey of more than 8 bits; colours of 16 bits are reduced.
    """
    header = read_header(path)
    check_sides(path, *header.size_hw)
    check_photo(path, header)
    return read_rgb8(path)


def check_sides(path: Path, height: int, width: int) -> None:
    """Refuse, by its header, an image that is as narrow as a line.

    Raises:
        DataError: names the file, the rule and what was found.
    """
    if max(height, width) > LONGEST * min(height, width):
        raise DataError(
            f"{path}: expected sides of which one is at most {LONGEST} times the other, "
            f"got {height} x {width}"
        )
