"""A predicted frame, and the files and pictures that are made of it."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float

from col3d.data.files.encode import depth_codes, normal_codes, write_tiff
from col3d.data.files.images import SourceImage
from col3d.geometry import Camera, points_from_depth
from col3d.reports.clouds import write_cloud
from col3d.reports.previews import SideBySide, depth_picture, normals_picture

TENS = 10.0
"""Step in mm in which the colour range of a video grows."""
EVERY = 4
"""Distance in pixels between the samples at which flicker is measured."""
SHOWN = 360
"""Height of pictures in previews."""


@dataclass(frozen=True)
class Predicted:
    """A frame with a network's prediction for it.

    Attributes:
        shot: the image.
        depth: depth in mm, or without unit if the camera is unknown.
        normals: unit vectors; None if the network predicts none.
        mask: pixels that the endoscope shows; None for all.
        camera: camera of the image; None if unknown.
        seconds: time that the network took.
    """

    shot: SourceImage
    depth: Float[np.ndarray, "h w"]
    normals: Float[np.ndarray, "h w 3"] | None
    mask: Bool[np.ndarray, "h w"] | None
    camera: Camera | None
    seconds: float

    @property
    def counting(self) -> Float[np.ndarray, " n"]:
        """Depth of the pixels that the endoscope shows."""
        return self.depth.ravel() if self.mask is None else self.depth[self.mask]


class CodeFiles:
    """Writer of `frames/NAME_depth.tiff` and `NAME_normals.tiff`, encoded as in C3VD's current release."""

    def __init__(self, folder: Path, max_depth: float) -> None:
        self.folder, self.max_depth = folder / "frames", max_depth

    def __call__(self, frame: Predicted) -> None:
        """Write the files of a frame."""
        name = frame.shot.name
        codes = depth_codes(frame.depth, self.max_depth, frame.mask)
        write_tiff(self.folder / f"{name}_depth.tiff", codes)
        if frame.normals is not None:
            write_tiff(self.folder / f"{name}_normals.tiff", normal_codes(frame.normals, frame.mask))


class Clouds:
    """Writer of `clouds/NAME.ply`: coloured points along the rays of the camera."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder / "clouds"

    def __call__(self, frame: Predicted) -> None:
        """Write the cloud of a frame."""
        assert frame.camera is not None
        assert frame.shot.image is not None
        depth = torch.from_numpy(frame.depth)[None, None]
        points = points_from_depth(depth, frame.camera.rays())[0].permute(1, 2, 0).numpy()
        mask = np.ones(frame.depth.shape, bool) if frame.mask is None else frame.mask
        write_cloud(self.folder / f"{frame.shot.name}.ply", points[mask], frame.shot.image[mask])


class Pictures:
    """Draws image, depth and normals of frames side by side.

    Args:
        span: range of depth that the colours span; that of each image when None.
        unit: unit of depth on the colour bar.
        is_series: whether frames share their colours: the range then begins at 0, and its end only grows, in
            steps of ten.
    """

    def __init__(self, span: tuple[float, float] | None, unit: str, is_series: bool) -> None:
        self.span, self.unit, self.is_series = span, unit, is_series
        self.highest = 0.0
        self.pages: dict[tuple[Any, ...], SideBySide] = {}

    def __call__(self, frame: Predicted) -> np.ndarray:
        """Draw the picture of a frame, RGB."""
        assert frame.shot.image is not None
        low, high = self.span or self._span(frame)
        pictures = [frame.shot.image, depth_picture(frame.depth, low, high, frame.mask)]
        if frame.normals is not None:
            pictures.append(normals_picture(frame.normals, frame.mask))
        return self._page(frame.depth.shape, len(pictures), (low, high))(pictures)

    def _span(self, frame: Predicted) -> tuple[float, float]:
        low, high = np.quantile(frame.counting, [0.01, 0.99]).tolist()
        if not self.is_series:
            return low, high
        self.highest = max(self.highest, math.ceil(high / TENS) * TENS)
        return 0.0, self.highest

    def _page(self, size_hw: tuple[int, ...], count: int, span: tuple[float, float]) -> SideBySide:
        """Return the layout for a size and colours, cached until they change."""
        key = (size_hw, count, span)
        if key not in self.pages:
            width = max(round(size_hw[1] * SHOWN / size_hw[0]), 1)
            titles = ("image", "depth", "normals")[:count]
            self.pages = {key: SideBySide(titles, (SHOWN, width), *span, self.unit)}
        return self.pages[key]


def sparse_depth(frame: Predicted) -> torch.Tensor:
    """Return depth (1, 1, h, w) of every fourth pixel each way, NaN where the endoscope shows nothing."""
    depth = torch.from_numpy(frame.depth)[::EVERY, ::EVERY]
    if frame.mask is not None:
        depth = depth.masked_fill(~torch.from_numpy(frame.mask)[::EVERY, ::EVERY], torch.nan)
    return depth[None, None]
