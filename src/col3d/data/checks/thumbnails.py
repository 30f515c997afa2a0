"""Thumbnails of a frame, as far as its files can be decoded."""

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from col3d.data.checks.salvage import read_in_part
from col3d.data.datasets.frame_files import Frame
from col3d.data.datasets.frame_set import FrameSet
from col3d.errors import DataError


@dataclass(frozen=True)
class Thumbnail:
    """Small pictures of one frame; None for files that are absent or cannot be decoded at all.

    Attributes:
        image: RGB.
        depth: mm, NaN where it does not count.
        normals: as stored, 8 bits of each channel.
    """

    image: UInt8[np.ndarray, "h w 3"] | None
    depth: Float32[np.ndarray, "h w"] | None
    normals: UInt8[np.ndarray, "h w 3"] | None


def thumbnail(frames: FrameSet, frame: Frame, width: int) -> Thumbnail:
    """Small pictures of a frame.

    Args:
        frames: frames of the data set.
        frame: the frame, with the files that exist.
        width: width in pixels.
    """
    decoded = {kind: _read(frames, kind, path) for kind, path in frame.files.items()}
    image, codes, normals = (decoded.get(kind) for kind in ("color", "depth", "normals"))
    return Thumbnail(
        image=None if image is None else _small(_colours(image), width, cv2.INTER_AREA),
        depth=None if codes is None or codes.ndim != 2 else _small(_shown(frames, codes), width),
        normals=None if normals is None else _small(_colours(normals), width),
    )


def _read(frames: FrameSet, kind: str, path: Path) -> np.ndarray | None:
    if kind == "depth":
        with suppress(DataError):
            return frames.depth_codes(path)
    return read_in_part(path)


def _colours(pixels: np.ndarray) -> np.ndarray:
    """Three channels of 8 bits, red first, from pixels of any form."""
    channels = pixels if pixels.ndim == 3 else pixels[..., None]
    three = [0, 1, 2] if channels.shape[-1] >= 3 else [0, 0, 0]
    eight = channels >> 8 if channels.dtype == np.uint16 else channels
    return np.ascontiguousarray(eight[..., three].astype(np.uint8))


def _shown(frames: FrameSet, codes: np.ndarray) -> np.ndarray:
    depth = frames.decoded_depth(codes)
    return np.where(depth.known, depth.mm, np.float32("nan"))


def _small(pixels: np.ndarray, width: int, how: int = cv2.INTER_NEAREST) -> np.ndarray:
    height = max(1, round(pixels.shape[0] * width / pixels.shape[1]))
    return cv2.resize(pixels, (width, height), interpolation=how)
