"""Formats of images and videos that may be opened, by the names that their decoders use.

Decoders choose by a file's content, not by its name: without these lists an EPS file named `.png` would start
Ghostscript, and a text file named `.mp4` would be played as a list of other files.
"""

import os
from pathlib import Path

import cv2

IMAGE_FORMATS = ("PNG", "JPEG", "BMP", "TIFF", "WEBP")
"""Pillow's names, for the argument `formats` of `Image.open`."""
MOVING_FORMATS = (*IMAGE_FORMATS, "GIF")
"""Formats of files that may hold several pictures."""
DEMUXERS = (
    *("mov", "avi", "matroska", "mpeg", "mpegts", "mpegvideo", "m4v", "asf", "ogg"),
    *("flv", "mxf", "h264", "hevc"),
)
"""FFmpeg's demuxers of files that contain their pictures, rather than refer to other files."""
SILENT = "-8"
STARTS = {
    b"\x89PNG\r\n\x1a\n": "PNG",
    b"\xff\xd8\xff": "JPEG",
    b"BM": "BMP",
    b"II*\0": "TIFF",
    b"MM\0*": "TIFF",
    b"II+\0": "TIFF",
    b"MM\0+": "TIFF",
    b"GIF87a": "GIF",
    b"GIF89a": "GIF",
}
"""First bytes of a file, and the format that they identify."""


def image_format(path: Path) -> str:
    """Identify a file's format by its first bytes: Pillow's name, or "" if it is none of `MOVING_FORMATS`.

    Raises:
        OSError: the file cannot be read.
    """
    with path.open("rb") as file:
        head = file.read(12)
    if head[:4] == b"RIFF" and head[8:] == b"WEBP":
        return "WEBP"
    return next((name for start, name in STARTS.items() if head.startswith(start)), "")


def open_video(path: Path) -> cv2.VideoCapture:
    """Open a video file with OpenCV; the capture is not opened if the file is missing or none of `DEMUXERS`.

    OpenCV passes options to FFmpeg only through the environment. The path is made absolute so that it cannot
    be read as a protocol (`concat:a.mp4|b.mp4`). FFmpeg, unlike OpenCV's reader of numbered images, takes
    `%02d` in a name literally.
    """
    limits = f"protocol_whitelist;file|format_whitelist;{','.join(DEMUXERS)}"
    os.environ["OPENCV_FFMPEG_CAPTURE_OPTIONS"] = limits
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", SILENT)
    before = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        return cv2.VideoCapture(str(path.absolute()), cv2.CAP_FFMPEG)
    finally:
        cv2.utils.logging.setLogLevel(before)
