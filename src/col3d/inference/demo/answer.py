"""The prediction for one image, and the pictures of it."""

from dataclasses import dataclass

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8

from col3d.errors import DataError
from col3d.geometry import Camera
from col3d.inference.cameras import CameraOption, camera_at, lens_of, view_of
from col3d.inference.demo.uploads import MOST_SIDE, Truth, fitted
from col3d.inference.predictor import Predictor
from col3d.layers.network import needs_rays
from col3d.metrics.functional import depth_metrics
from col3d.registry.metric_specs import OURS
from col3d.reports.previews import depth_picture, normals_picture, with_colour_bar

SCORES = ("abs_rel", "rmse", "delta1")
SHOWN_SIDE = 420
"""Pixels of the longer side of pictures with a scale, so that its letters do not shrink with the page."""
Picture = UInt8[np.ndarray, "_ _ 3"]


@dataclass(frozen=True)
class Answer:
    """A network's prediction for one image.

    Attributes:
        image: RGB, at the displayed size.
        depth: depth in mm; without a camera relative to the largest, because the scale is unknown.
        normals: unit vectors; None if the network predicts none.
        mask: pixels that the endoscope shows.
        camera: camera of the image; None if unknown.
        truth: ground truth; None if it was not given, or cannot be compared without a camera.
        known_lens: whether the network was trained with this lens.
    """

    image: Picture
    depth: Float[np.ndarray, "h w"]
    normals: Float[np.ndarray, "h w 3"] | None
    mask: Bool[np.ndarray, "h w"]
    camera: Camera | None
    truth: Truth | None
    known_lens: bool

    @property
    def unit(self) -> str:
        """Unit of the colour bar."""
        return "relative" if self.camera is None else "mm"

    @property
    def span(self) -> tuple[float, float]:
        """Initial range of the colours: the 1st and 99th percentiles of depth."""
        low, high = np.quantile(self.depth[self.mask], [0.01, 0.99])
        return float(low), float(high)

    def depth_picture(self, low: float, high: float) -> Picture:
        """Draw depth in colours from `low` to `high`, with their scale."""
        low, high = min(low, high), max(low, high)
        return _with_scale(depth_picture(self.depth, low, high, self.mask), low, high, self.unit, "viridis")

    def normals_picture(self) -> Picture | None:
        """Draw normals: x as red, -y as green, -z as blue."""
        return None if self.normals is None else shown(normals_picture(self.normals, self.mask))

    def error_picture(self) -> Picture | None:
        """Draw the absolute error in mm; None without ground truth."""
        if self.truth is None:
            return None
        error, counts = np.abs(self.depth - self.truth.depth), self.mask & self.truth.mask
        high = max(float(np.quantile(error[counts], 0.98)), 0.1)
        return _with_scale(depth_picture(error, 0.0, high, counts, "magma"), 0.0, high, "mm", "magma")

    def scores(self) -> dict[str, float]:
        """Compute metrics of depth against the ground truth, by their headings."""
        if self.truth is None:
            return {}
        counts = self.mask & self.truth.mask
        preds, target, mask = (
            torch.from_numpy(values)[None, None] for values in (self.depth, self.truth.depth, counts)
        )
        metrics = depth_metrics(preds, target, mask)
        return {OURS[name].screen_title: float(metrics[name]) for name in SCORES}


def answer(network: Predictor, image: Picture, option: CameraOption, truth: Truth | None = None) -> Answer:
    """Predict one image.

    Args:
        network: the predictor.
        image: RGB of any size; reduced first if it is larger than the displayed size.
        option: the camera; see `lens_of`.
        truth: ground truth at the size of the image; ignored without a camera, because it is in mm.

    Raises:
        DataError: the camera does not fit the image, or is required and missing.
        UserError: there is no such camera.
    """
    size_hw = (image.shape[0], image.shape[1])
    lens = lens_of(option)
    if lens is None and needs_rays(network.network):
        raise DataError("camera: this network needs the camera's viewing rays; choose one")
    camera = None if lens is None else camera_at(lens, size_hw)
    image = fitted(image)
    shown_hw = (image.shape[0], image.shape[1])
    camera = None if camera is None else camera.resized(shown_hw)
    depth, normals = predicted(network, image, camera)
    view = view_of(option, shown_hw)
    mask = np.ones(shown_hw, bool) if view is None else view[0].numpy()
    if camera is None:
        depth, truth = depth / depth.max(), None
    if truth is not None:
        truth = Truth(fitted(truth.depth, exact=True), fitted(truth.mask.view(np.uint8), exact=True) > 0)
        if not (truth.mask & mask).any():
            raise DataError("true depth: no pixel of it is known")
    return Answer(image, depth, normals, mask, camera, truth, camera is not None and network.knows(camera))


def predicted(
    network: Predictor, image: Picture, camera: Camera | None
) -> tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "h w 3"] | None]:
    """Predict depth in mm and normals of one image."""
    pixels = torch.from_numpy(np.array(image)).permute(2, 0, 1)[None]
    prediction = network.predict(pixels, camera)
    depth = prediction["depth"][0, 0].cpu().numpy()
    normals = prediction["normals"][0].permute(1, 2, 0).cpu().numpy() if "normals" in prediction else None
    return depth, normals


def shown(picture: Picture, most_side: int = MOST_SIDE) -> Picture:
    """Resize a picture to between `SHOWN_SIDE` and `most_side` pixels; small ones keep visible pixels."""
    height, width = picture.shape[:2]
    share = SHOWN_SIDE / max(height, width)
    if share <= 1:
        return fitted(picture, most_side)
    larger = (round(width * share), round(height * share))
    return cv2.resize(picture, larger, interpolation=cv2.INTER_NEAREST)


def _with_scale(picture: Picture, low: float, high: float, unit: str, scale: str) -> Picture:
    return with_colour_bar(shown(picture, SHOWN_SIDE), low, high, unit, scale)
