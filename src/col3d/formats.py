"""The formats of images and videos that are opened, by the names their decoders have for them.

Decoders choose by what is in a file, not by its name: without these lists an EPS called `.png` starts
Ghostscript, and a text called `.mp4` is played as the list of other files that it is.
"""

import os
from pathlib import Path

import cv2

IMAGE_FORMATS = ("PNG", "JPEG", "BMP", "TIFF", "WEBP")
"""Pillow's; for `formats` of each `Image.open`."""
DEMUXERS = ("mov", "avi", "matroska", "mpeg", "mpegts", "mpegvideo", "m4v", "asf", "ogg")
"""FFmpeg's, of files that hold their pictures themselves."""
SILENT = "-8"


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
