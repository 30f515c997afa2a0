"""Images from anywhere: a file, a folder, a pattern, a video file, or a video of C3VD, one by one."""

import glob
import os
import re
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from col3d.checks import DataError
from col3d.data.c3vd import C3VD
from col3d.formats import IMAGE_FORMATS, open_video

IMAGE_ENDINGS = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
VIDEO_ENDINGS = (".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg", ".wmv", ".ogv")
EIGHT_BITS = ("1", "L", "LA", "P", "PA", "RGB", "RGBA", "RGBX", "CMYK", "YCbCr", "HSV", "LAB")
"""Pillow's names of what becomes RGB of 8 bits without loss of range."""
LONGEST = 20
"""Times the shorter side that the longer one of an image may be: pictures of a line have no bounds."""


@dataclass(frozen=True)
class Shot:
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
    """

    name: str
    is_video: bool
    fps: float | None = None
    count: int
    paths: tuple[Path, ...]

    @abstractmethod
    def __iter__(self) -> Iterator[Shot]:
        """Each image, or what is wrong with it."""


class ImageFiles(ImageSource):
    """Image files by number and name.

    Args:
        name: of the whole.
        files: by number.
        is_video: whether they are frames of one video, named by their numbers.
    """

    def __init__(self, name: str, files: dict[int, Path], is_video: bool) -> None:
        self.name, self.files, self.is_video, self.count = name, files, is_video, len(files)
        self.paths = tuple(files.values())
        self.names = [f"{number:04d}" for number in files] if is_video else _names(list(files.values()))

    def __iter__(self) -> Iterator[Shot]:
        for name, (number, path) in zip(self.names, self.files.items(), strict=True):
            try:
                yield Shot(name, number, read_image(path))
            except DataError as error:
                yield Shot(name, number, None, str(error))


class VideoFile(ImageSource):
    """The frames of a video file, as far as it can be decoded.

    Raises:
        DataError: it cannot be opened.
    """

    is_video = True

    def __init__(self, path: Path) -> None:
        self.path, self.name, self.paths = path, path.stem, (path,)
        capture = open_video(path)
        if not capture.isOpened():
            raise DataError(f"{path}: cannot be opened as a video")
        width, height = (capture.get(key) for key in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
        check_sides(path, int(height), int(width))
        self.fps = capture.get(cv2.CAP_PROP_FPS) or None
        self.count = max(int(capture.get(cv2.CAP_PROP_FRAME_COUNT)), 0)
        capture.release()

    def __iter__(self) -> Iterator[Shot]:
        capture = open_video(self.path)
        number = 0
        try:
            while True:
                read, frame = capture.read()
                if not read:
                    break
                yield Shot(f"{number:06d}", number, cv2.cvtColor(frame, cv2.COLOR_BGR2RGB))
                number += 1
        finally:
            capture.release()
        if number < self.count:
            lost = self.count - number
            fault = f"{self.path}: {lost} of {self.count} frames could not be decoded"
            yield Shot(f"{number:06d}", number, None, fault)


def image_source(given: str) -> ImageSource:
    """What a path or pattern stands for.

    Raises:
        DataError: there is nothing, or nothing that can be read as images.
    """
    path = Path(given)
    if path.is_dir():
        return _folder(path)
    if path.is_file():
        if path.suffix.lower() in VIDEO_ENDINGS:
            return VideoFile(path)
        return ImageFiles(path.stem, {0: path}, is_video=False)
    if any(sign in given for sign in "*?["):
        pattern = str(Path(glob.escape(str(path.parent))) / path.name) if path.parent.is_dir() else given
        found = [Path(name) for name in glob.glob(pattern, recursive=True)]  # noqa: PTH207 - absolute or not
        files = _images(found)
        if not files:
            raise DataError(f"input: {given} matches no image ({', '.join(IMAGE_ENDINGS)})")
        return ImageFiles(path.parent.name or "images", dict(enumerate(files)), is_video=False)
    raise DataError(f"input: no such file or folder: {given}")


def read_image(path: Path) -> np.ndarray:
    """Any whole image file as RGB (h, w, 3) in 8 bits, pixels as they lie in it.

    Raises:
        DataError: it is no image, is cut off, or is grey of more than 8 bits; colours of more are reduced.
    """
    try:
        with Image.open(path, formats=IMAGE_FORMATS) as image:
            check_sides(path, image.height, image.width)
            if image.mode not in EIGHT_BITS:
                raise DataError(f"{path}: expected an image of 8 bits a channel, got mode {image.mode}")
            return np.asarray(image.convert("RGB"))
    except DataError:
        raise
    except Exception as error:  # decoders fail in many ways over bytes that make no sense
        reason = " ".join(str(error).replace(str(path), "it").split()) or type(error).__name__
        raise DataError(f"{path}: not a readable image ({reason[:120]})") from None


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


def _folder(path: Path) -> ImageSource:
    """A video of C3VD or C3VDv2 by the names of its files, else all images in the folder."""
    if files := C3VD.kinds["color"].find(path):
        return ImageFiles(path.name, dict(sorted(files.items())), is_video=True)
    images = _images(list(path.iterdir()))
    if not images:
        raise DataError(f"input: {path} holds no image ({', '.join(IMAGE_ENDINGS)}) and no video of C3VD")
    return ImageFiles(path.name, dict(enumerate(images)), is_video=False)


def _images(paths: Sequence[Path]) -> list[Path]:
    chosen = [path for path in paths if path.suffix.lower() in IMAGE_ENDINGS and path.is_file()]
    return sorted(chosen, key=_by_numbers)


def _by_numbers(path: Path) -> list[tuple[int, int, str]]:
    """A key by which frame_9 comes before frame_10."""
    parts = re.split(r"(\d+)", str(path))
    return [(0, int(part), "") if part.isdecimal() else (1, 0, part) for part in parts]


def _names(paths: Sequence[Path]) -> list[str]:
    """Stems; where two files share one, as much of their paths as tells them apart."""
    stems = [_in_utf8(path.stem) for path in paths]
    if len(set(stems)) == len(stems):
        return stems
    absolute = [path.absolute() for path in paths]
    shared = Path(*_common([path.parent.parts for path in absolute]))
    parts = [path.relative_to(shared).parts for path in absolute]
    return _told_apart([_in_utf8("_".join(of_it)).replace(".", "_") for of_it in parts])


def _in_utf8(name: str) -> str:
    """A name of which every byte that is no UTF-8 became a question mark of Unicode's."""
    return os.fsencode(name).decode("utf-8", "replace")


def _told_apart(names: Sequence[str]) -> list[str]:
    """The names, with a number after those that came before."""
    found: list[str] = []
    for name in names:
        number, free = 2, name
        while free in found:
            number, free = number + 1, f"{name}_{number}"
        found.append(free)
    return found


def _common(parts: Sequence[tuple[str, ...]]) -> list[str]:
    columns = zip(*parts, strict=False)
    found: list[str] = []
    for column in columns:
        if len(set(column)) > 1:
            break
        found.append(column[0])
    return found
