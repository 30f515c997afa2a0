"""A network that has learned: the one of a checkpoint, and what is known of how it came about."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from jaxtyping import UInt8
from torch import Tensor, nn
from torch.nn.functional import interpolate

from col3d import weights
from col3d.app import build
from col3d.app.checkpoints import run_of
from col3d.app.starts import Starts
from col3d.app.trained import Trained, trained_options
from col3d.batch import Prediction, check_prediction
from col3d.checks import UserError
from col3d.data.resize import resized_image
from col3d.geometry import Camera, unit
from col3d.geometry.camera_file import camera_from_plain
from col3d.layers.network import DepthNetwork, device_of
from col3d.models.options import untrained
from col3d.models.published import load_published, read_weights
from col3d.tasks import SupervisedTask

MAX_DEPTH = 100.0
"""Millimetres that the published programs for C3VD are trained with."""
SIZE = (320, 320)
"""Height and width that they see."""
SHIPPED = "shipped"
"""In place of a checkpoint's path: the small network that comes with the package. A file that is called so
itself is reached by its absolute path."""
SAME_LENS = 1e-3
"""Largest difference of two unit rays of one lens."""


@dataclass(frozen=True)
class Learnt:
    """A network with its final weights, ready for images of any size.

    Attributes:
        network: in evaluation mode.
        name: of the model, or of whose weights it holds.
        size_hw: that it sees; images are resized to it.
        max_depth: the largest depth in mm that it can say.
        cameras: of the frames it was trained on, at that size; empty where nobody knows.
        trained_on: names of those data sets.
    """

    network: nn.Module
    name: str
    size_hw: tuple[int, int]
    max_depth: float
    cameras: tuple[Camera, ...]
    trained_on: tuple[str, ...]

    @torch.inference_mode()
    def predict(self, images: UInt8[Tensor, "b 3 h w"], camera: Camera | None = None) -> Prediction:
        """Depth and normals of images, on the network's device, at the images' own size.

        The images are resized as in training; what the network says is read off between its pixels,
        bilinearly.

        Args:
            images: RGB in 8 bits.
            camera: of the images, at their size; needed by networks whose `needs_rays` is True.

        Raises:
            ValueError: the camera is needed and absent, or is of another size.
            UserError: the network gives numbers that are not finite.
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
        """Move the network to where an option `accelerator` says: auto takes a GPU where there is one."""
        on_cpu = accelerator == "cpu" or not torch.cuda.is_available()
        self.network.to("cpu" if on_cpu else "cuda")

    def knows(self, camera: Camera) -> bool:
        """Whether images of this camera have the lens of frames that the network was trained on."""
        rays = camera.resized(self.size_hw).rays()
        return any(bool((rays - known.rays()).abs().max() < SAME_LENS) for known in self.cameras)


def _at(values: Tensor, size_hw: tuple[int, int]) -> Tensor:
    return interpolate(values, size_hw, mode="bilinear", align_corners=False)


def learnt(
    path: Path,
    published: str | None = None,
    max_depth: float | None = None,
    size: Sequence[int] | None = None,
) -> Learnt:
    """The network of a checkpoint.

    Args:
        path: of a checkpoint of `train.py`, or of the authors.
        published: whose weights it holds; None for a checkpoint of `train.py`.
        max_depth: millimetres that published weights were trained with; 100 when absent.
        size: height and width that published weights see; 320 x 320 when absent.

    Raises:
        UserError: the file is no such checkpoint.
    """
    if published is not None:
        network = published_network(path, published, max_depth)
        height, width = size or SIZE
        return Learnt(network, published, (height, width), max_depth or MAX_DEPTH, (), ())
    if max_depth is not None or size is not None:
        option = "max_depth" if size is None else "size"
        raise UserError(f"{option}: our checkpoints know theirs; it is for published weights")
    task, trained, checkpoint = trained_task(path)
    cameras, model = _cameras(checkpoint, path), trained.model
    whole = task.network.eval()
    return Learnt(whole, model.name, trained.size_hw, model.max_depth, cameras, trained.trained_on)


def _cameras(checkpoint: Mapping[str, Any], path: Path) -> tuple[Camera, ...]:
    """The cameras of the frames that a checkpoint was trained on, which need not say."""
    about = checkpoint.get("about") or {}
    try:
        return tuple(camera_from_plain(plain) for plain in about.get("cameras", ()))
    except (AttributeError, TypeError, ValueError, ArithmeticError, RecursionError) as error:
        raise UserError(
            f"checkpoint: {path}: what it says about its cameras is not as train.py writes it ({error})"
        ) from None


def trained_task(path: Path) -> tuple[SupervisedTask, Trained, Mapping[str, Any]]:
    """A task with the network of a checkpoint of `train.py`, the options of its training, and all it holds.

    Raises:
        UserError: it is no such checkpoint, or of another version.
    """
    checkpoint = read_file(path)
    _check_run(path, checkpoint)
    trained = trained_options(checkpoint, path)
    task = SupervisedTask(build.network(untrained(trained.model), trained.size_hw), options=trained.content)
    build.fill_network(task, checkpoint, path)
    return task, trained, checkpoint


def published_network(path: Path, source: str, max_depth: float | None = None) -> DepthNetwork:
    """The network of a checkpoint that the authors' program saved.

    Raises:
        UserError: it is not theirs.
    """
    if str(path) == SHIPPED:
        raise UserError(
            f"checkpoint: a value is needed, the file of the weights that published={source} names"
        )
    try:
        return load_published(source, read_file(path), max_depth or MAX_DEPTH)
    except ValueError as error:
        raise UserError(str(error).replace("state_dict:", f"checkpoint: {path}", 1)) from None


def located(checkpoint: Path) -> Path:
    """The file of a checkpoint: the path itself, but for the network that is shipped."""
    return Path(weights.__file__).with_name("shipped.ckpt") if str(checkpoint) == SHIPPED else checkpoint


def _check_run(path: Path, checkpoint: Mapping[str, Any]) -> None:
    """Refuse a checkpoint that another run left in the folder of a run."""
    folder, run = path.absolute().parent, run_of(checkpoint)
    home = Starts(folder.parent).run if folder.name == "checkpoints" else ""
    if run is not None and home and run != home:
        raise UserError(
            f"checkpoint: {path} is of another run than {folder.parent}: put that run's own back, or copy "
            "this one to another place"
        )


def read_file(path: Path) -> dict[str, Any]:
    """What a file of weights holds, with every byte checked.

    Raises:
        UserError: there is no such file, or it is damaged or of something else.
    """
    if str(path) == SHIPPED:
        _check_shipped(located(path))
    try:
        return read_weights(located(path))
    except ValueError as error:
        raise UserError(str(error)) from None


def _check_shipped(path: Path) -> None:
    """Hold the file that comes with the package against the sum that does."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise UserError(f"checkpoint: {path} of this package cannot be read ({error.strerror})") from None
    if hashlib.sha256(content).hexdigest() != weights.SHIPPED_SHA256:
        raise UserError(
            f"checkpoint: {path} is damaged: it is not the file of this package; install it again"
        )
