"""Write pictures to a video file, in the best codec that OpenCV can write on this machine."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

os.environ.setdefault(
    "OPENCV_FFMPEG_LOGLEVEL", "-8"
)  # before its first use: an absent encoder needs no message

import cv2
import numpy as np
from jaxtyping import UInt8

from col3d.io.formats import open_video

CODES = ("avc1", "vp09", "mp4v")
"""H.264, which everything plays; VP9, which browsers and VLC play; MPEG-4, which OpenCV always has."""


class VideoWriter:
    """Appends pictures of one size to an MP4 file.

    Args:
        path: file to write; it has another name until `close`.
        fps: pictures a second.
    """

    def __init__(self, path: Path, fps: float) -> None:
        self.path, self.fps = path, fps
        self.partial = path.with_name(f".{path.name}.partial.mp4")
        self.code, self.size_hw, self.count = "", (0, 0), 0
        self.writer: cv2.VideoWriter | None = None

    def add(self, picture: UInt8[np.ndarray, "h w 3"]) -> None:
        """Append a picture, RGB with even sides; one of another size than the first is fitted into its size.

        Raises:
            OSError: no code can be written here.
        """
        if self.writer is None:
            self.size_hw = (picture.shape[0], picture.shape[1])
            self.code, self.writer = _opened(self.partial, self.fps, self.size_hw)
        elif picture.shape[:2] != self.size_hw:
            picture = cv2.resize(picture, self.size_hw[::-1], interpolation=cv2.INTER_AREA)
        with _silently():
            self.writer.write(picture[..., ::-1])
        self.count += 1

    def close(self) -> None:
        """Finish the file; no file is left where nothing was added.

        Raises:
            OSError: the file does not hold every picture, which OpenCV does not report when a disk is full.
        """
        if self.writer is None:
            return
        self.writer.release()
        try:
            if (held := _pictures_in(self.partial)) < self.count:
                why = f"only {held} of its {self.count} pictures are in the file; is the disk full?"
                raise OSError(errno.EIO, why, str(self.path))
            self.partial.replace(self.path)
        finally:
            self.partial.unlink(missing_ok=True)


def _pictures_in(path: Path) -> int:
    """Number of pictures that can be read back from a file."""
    capture, count = open_video(path), 0
    while capture.grab():
        count += 1
    capture.release()
    return count


def _opened(path: Path, fps: float, size_hw: tuple[int, int]) -> tuple[str, cv2.VideoWriter]:
    with _silently():
        for code in CODES:
            writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*code), fps, size_hw[::-1])
            if writer.isOpened():
                return code, writer
            path.unlink(missing_ok=True)
    raise OSError(f"{path}: OpenCV can write none of {', '.join(CODES)} here")


@contextmanager
def _silently() -> Iterator[None]:
    """Silence OpenCV's log inside the block: failures are raised as errors once, by the caller."""
    before = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        cv2.utils.logging.setLogLevel(before)
