"""Predictor: a trained network that takes images of any size."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from jaxtyping import UInt8
from torch import Tensor, nn
from torch.nn.functional import interpolate

from col3d.batch import Prediction, check_prediction
from col3d.data.resize import resized_image
from col3d.errors import UserError
from col3d.geometry import Camera, unit
from col3d.inference.trained_network import MAX_DEPTH, SIZE, published_network, trained_network
from col3d.layers.network import device_of
from col3d.runs.environment import device_for

SAME_LENS = 1e-3
"""Largest difference of unit rays within which two cameras count as one lens."""


@dataclass(frozen=True)
class Predictor:
    """A network with its final weights, ready for images of any size.

    Attributes:
        network: network in evaluation mode.
        name: name of the model, or of the published weights.
        size_hw: size of its input, to which images are resized.
        max_depth: the largest depth in mm that it can predict.
        cameras: cameras of the training frames, at that size; empty if unknown.
        trained_on: names of the data sets it was trained on.
    """

    network: nn.Module
    name: str
    size_hw: tuple[int, int]
    max_depth: float
    cameras: tuple[Camera, ...]
    trained_on: tuple[str, ...]

    @torch.inference_mode()
    def predict(self, images: UInt8[Tensor, "b 3 h w"], camera: Camera | None = None) -> Prediction:
        """Predict depth and normals of images, on the network's device, at the images' own size.

        The images are resized as in training; the prediction is resized back by bilinear interpolation.

        Args:
            images: RGB in 8 bits.
            camera: camera of the images, at their size; required by networks whose `needs_rays` is True.

        Raises:
            ValueError: the camera is required and absent, or is of another size.
            UserError: a prediction is not finite.
        """
        size_hw = (images.shape[2], images.shape[3])
        if camera is not None and camera.size_hw != size_hw:
            raise ValueError(f"camera: expected one of {size_hw} pixels, got {camera.size_hw}")
        device = device_of(self.network)
        seen = resized_image(images, self.size_hw).to(device).float() / 255
        rays = None if camera is None else camera.resized(self.size_hw).rays().to(device)
        prediction = self.network(seen, rays)
        check_prediction(prediction, seen, self.name)
        enlarged: Prediction = {"depth": _at(prediction["depth"].float(), size_hw)}
        if "normals" in prediction:
            enlarged["normals"] = unit(_at(prediction["normals"].float(), size_hw))
        for name, values in enlarged.items():
            if not bool(values.isfinite().all()):  # type: ignore[attr-defined]
                raise UserError(
                    f"checkpoint: {name} that {self.name} predicts is not finite: its weights are damaged, "
                    "or of a training that diverged"
                )
        return enlarged

    def place(self, accelerator: str) -> None:
        """Move the network to the device of an option `accelerator`: auto takes a GPU if there is one."""
        self.network.to(device_for(accelerator))

    def knows(self, camera: Camera) -> bool:
        """Whether a camera has the lens of the frames that the network was trained on."""
        rays = camera.resized(self.size_hw).rays()
        return any(bool((rays - known.rays()).abs().max() < SAME_LENS) for known in self.cameras)


def _at(values: Tensor, size_hw: tuple[int, int]) -> Tensor:
    return interpolate(values, size_hw, mode="bilinear", align_corners=False)


def load_predictor(
    path: Path,
    published: str | None = None,
    max_depth: float | None = None,
    size: Sequence[int] | None = None,
) -> Predictor:
    """Load a predictor from a checkpoint.

    Args:
        path: path of a checkpoint of `train.py`, or of the authors.
        published: name of the published weights; None for a checkpoint of `train.py`.
        max_depth: largest depth in mm of published weights; 100 when absent.
        size: height and width of the input of published weights; 320 x 320 when absent.

    Raises:
        UserError: the file is no such checkpoint.
    """
    if published is not None:
        network = published_network(path, published, max_depth)
        height, width = size or SIZE
        return Predictor(network, published, (height, width), max_depth or MAX_DEPTH, (), ())
    if max_depth is not None or size is not None:
        option = "max_depth" if size is None else "size"
        raise UserError(f"{option}: only for published weights; our checkpoints store it")
    loaded = trained_network(path)
    trained, model = loaded.trained, loaded.trained.model
    return Predictor(
        loaded.network, model.name, trained.size_hw, model.max_depth, loaded.cameras, trained.trained_on
    )
