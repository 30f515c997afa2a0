"""Sources of many pictures in one file: videos, animations, and multi-page TIFFs."""

import warnings
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from col3d.data.files.decode import TAKEN, read_rgb8, refusals
from col3d.data.files.headers import check_photo, read_header
from col3d.data.files.sources import ImageSource, SourceImage, check_sides
from col3d.data.files.tiff import page_numbers
from col3d.data.files.video_containers import container_of, declared_length, missing_bytes
from col3d.errors import DataError, DiskError
from col3d.io.formats import MOVING_FORMATS, image_format, open_video

GIF_END = b";"


class VideoFile(ImageSource):
    """The frames of a video file, as far as it can be decoded.

    The number of frames is known only after the last one: a container's count is the product of its length
    and a rate, which need not be constant.

    Raises:
        DataError: it cannot be opened, or not even its first frame can be decoded.
    """

    is_video = True

    def __init__(self, path: Path) -> None:
        self.path, self.name, self.paths = path, path.stem, (path,)
        capture = open_video(path)
        if not capture.isOpened():
            raise DataError(f"{path}: cannot be opened as a video{_why_not(path)}")
        width, height = (capture.get(key) for key in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
        self.size_hw = (int(height), int(width))
        check_sides(path, *self.size_hw)
        self.fps = capture.get(cv2.CAP_PROP_FPS) or None
        self.count = max(int(capture.get(cv2.CAP_PROP_FRAME_COUNT)), 0)
        decoded, _ = capture.read()  # an AVIF, say, opens without a decoder for what is in it
        capture.release()
        if not decoded:
            missing = missing_bytes(path)
            why = f"it is damaged, or of a kind that is not taken; of images {TAKEN}"
            why = f"the file is cut off: {missing} bytes are missing" if missing else why
            raise DataError(f"{path}: no frame of it can be decoded; {why}")
        if declared_length(path) is None:
            kind = container_of(path) or "file of this kind"
            self.notes = (
                f"note: {path}: a {kind} need not say how long it is, and this one does not: nothing tells "
                "whether its end is missing",
            )

    def sizes(self) -> Iterator[tuple[int, int]]:
        """Yield the size that all frames have."""
        yield self.size_hw

    def __iter__(self) -> Iterator[SourceImage]:
        capture = open_video(self.path)
        number = 0
        try:
            while True:
                read, frame = capture.read()
                if not read:
                    break
                yield SourceImage(f"{number:06d}", number, cv2.cvtColor(frame, cv2.COLOR_BGR2RGB))
                number += 1
        finally:
            capture.release()
        if missing := missing_bytes(self.path):
            fault = f"the file is cut off: {missing} bytes are missing, {number} frames are there"
            yield SourceImage(f"{number:06d}", number, None, f"{self.path}: {fault}")


class Pictures(ImageSource):
    """The frames of a GIF, WebP or APNG, or the pages of a TIFF.

    Args:
        path: the file.

    Raises:
        DataError: it is none of these formats, or cut off.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.name, self.paths = path, path.stem, (path,)
        self.format = image_format(path)
        if self.format == "GIF":
            self.size_hw, self.count = _animation(path)
        else:
            header = read_header(path)
            check_photo(path, header)
            self.size_hw, self.count = header.size_hw, header.pages
        check_sides(path, *self.size_hw)
        self.is_video = self.format != "TIFF" and self.count > 1
        self.fps = _rate(path) if self.is_video else None

    def sizes(self) -> Iterator[tuple[int, int]]:
        """Yield the size of the first picture."""
        yield self.size_hw

    def __iter__(self) -> Iterator[SourceImage]:
        if self.format == "TIFF":
            pages = page_numbers(self.path)
            yield from self._shots(lambda number: read_rgb8(self.path, pages[number]))
        else:
            with _opened(self.path) as image:  # once: each frame is decoded from the one before
                yield from self._shots(partial(self._frame, image))

    def _shots(self, read: Callable[[int], np.ndarray]) -> Iterator[SourceImage]:
        for number in range(self.count):
            name = f"{number:06d}" if self.count > 1 else self.name
            try:
                yield SourceImage(name, number, read(number))
            except DiskError:
                raise
            except DataError as error:
                yield SourceImage(name, number, None, f"{error} (picture {number + 1} of {self.count})")

    def _frame(self, image: Image.Image, number: int) -> np.ndarray:
        with refusals(self.path), warnings.catch_warnings(action="ignore"):
            image.seek(number)
            return np.asarray(image.convert("RGB"))


def _why_not(path: Path) -> str:
    """Reason why a file that begins as a video cannot be opened; empty where it does not begin as one."""
    container = container_of(path)
    if not container:
        return ""
    if missing := missing_bytes(path):
        return f": the file is cut off: {missing} bytes are missing"
    return f", though it begins as one ({container}): it is damaged, or of a kind that is not taken"


def as_pictures(path: Path) -> Pictures | None:
    """A file as `Pictures` if it is a GIF or holds several pictures; None if it is a photo.

    Raises:
        DataError: its format is not supported, or it is cut off.
    """
    name = image_format(path)
    if name not in MOVING_FORMATS:
        raise DataError(f"{path}: not a readable image ({TAKEN})")
    if name == "JPEG" or (name != "GIF" and read_header(path).pages == 1):
        return None
    return Pictures(path)


def _opened(path: Path) -> Image.Image:
    return Image.open(path, formats=MOVING_FORMATS)


def _animation(path: Path) -> tuple[tuple[int, int], int]:
    """Height and width, and the number of frames, of a GIF."""
    if not path.read_bytes().rstrip(b"\0").endswith(GIF_END):
        raise DataError(f"{path}: the file is cut off; copy it again")
    with refusals(path), warnings.catch_warnings(action="ignore"), _opened(path) as image:
        return (image.height, image.width), int(getattr(image, "n_frames", 1))


def _rate(path: Path) -> float | None:
    """Frames a second, by the time that the first frame is shown; None where it is not known."""
    with refusals(path), warnings.catch_warnings(action="ignore"), _opened(path) as image:
        image.load()  # before this, nothing is known of a WebP
        milliseconds = float(image.info.get("duration", 0))
    return 1000 / milliseconds if milliseconds > 0 else None
