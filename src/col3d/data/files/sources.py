"""What a source of images is: one after the other, none kept."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from col3d.data.files.decode import read_rgb8
from col3d.data.files.headers import check_photo, read_header
from col3d.errors import DataError

LONGEST = 20
"""Times the shorter side that the longer one of an image may be: pictures of a line have no bounds."""


@dataclass(frozen=True)
class SourceImage:
    """One image of a source.

    Attributes:
        name: for files that are written of it; no other of the source has it.
        number: of the frame, or the image's place.
        image: RGB (h, w, 3) in 8 bits; None where it cannot be read.
        fault: what is wrong with it, in words, or nothing.
    """

    name: str
    number: int
    image: np.ndarray | None
    fault: str = ""


class ImageSource(ABC):
    """Images one after the other, none kept.

    Attributes:
        name: of the whole.
        is_video: whether each image follows on the one before in time.
        fps: frames a second; None where nobody says.
        count: how many there are, as far as is known before they are read.
        paths: of the files that are read.
        notes: lines on what is not taken.
    """

    name: str
    is_video: bool
    fps: float | None = None
    count: int
    paths: tuple[Path, ...]
    notes: tuple[str, ...] = ()

    @abstractmethod
    def __iter__(self) -> Iterator[SourceImage]:
        """Each image, or what is wrong with it."""

    @abstractmethod
    def sizes(self) -> Iterator[tuple[int, int]]:
        """Height and width of images by their headers, as they are asked for; broken ones are passed over."""


def read_image(path: Path) -> np.ndarray:
    """Any whole image file as RGB (h, w, 3) in 8 bits, pixels as they lie in it.

    Raises:
        DataError: it is no image, is damaged, or is grey of more than 8 bits; colours of 16 are reduced.
    """
    header = read_header(path)
    check_sides(path, *header.size_hw)
    check_photo(path, header)
    return read_rgb8(path)


def check_sides(path: Path, height: int, width: int) -> None:
    """Refuse by its header what is a line rather than an image.

    Raises:
        DataError: names the file, the rule and what came.
    """
    if max(height, width) > LONGEST * min(height, width):
        raise DataError(
            f"{path}: expected sides of which one is at most {LONGEST} times the other, "
            f"got {height} x {width}"
        )
