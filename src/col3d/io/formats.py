"""The formats of images and videos that are opened, by the names their decoders have for them.

Decoders choose by what is in a file, not by its name: without these lists an EPS called `.png` starts
Ghostscript, and a text called `.mp4` is played as the list of other files that it is.
"""

import os
from pathlib import Path

import cv2

IMAGE_FORMATS = ("PNG", "JPEG", "BMP", "TIFF", "WEBP")
"""Pillow's; for `formats` of each `Image.open`."""
MOVING_FORMATS = (*IMAGE_FORMATS, "GIF")
"""Of files that may hold several pictures."""
DEMUXERS = (
    *("mov", "avi", "matroska", "mpeg", "mpegts", "mpegvideo", "m4v", "asf", "ogg"),
    *("flv", "mxf", "h264", "hevc"),
)
"""FFmpeg's, of files that hold their pictures themselves."""
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
"""The first bytes of formats."""


def image_format(path: Path) -> str:
    """Pillow's name of a file's format by its first bytes; nothing where it is none of `MOVING_FORMATS`.

    Raises:
        OSError: the file cannot be read.
    """
    with path.open("rb") as file:
        head = file.read(12)
    if head[:4] == b"RIFF" and head[8:] == b"WEBP":
        return "WEBP"
    return next((name for start, name in STARTS.items() if head.startswith(start)), "")


def open_video(path: Path) -> cv2.VideoCapture:
    """OpenCV's capture of a video file; not opened where the file is none of `DEMUXERS`, or none at all.

    OpenCV hands options on to FFmpeg in its environment alone. An absolute path cannot be taken for a
    protocol (`concat:a.mp4|b.mp4`), and FFmpeg, unlike OpenCV's reader of numbered images, takes `%02d` in
    a name as it is.
    """
    limits = f"protocol_whitelist;file|format_whitelist;{','.join(DEMUXERS)}"
    os.environ["OPENCV_FFMPEG_CAPTURE_OPTIONS"] = limits
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", SILENT)
    before = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        return cv2.VideoCapture(str(path.absolute()), cv2.CAP_FFMPEG)
    finally:
        cv2.utils.logging.setLogLevel(before)
