"""Loading of networks from checkpoints: our own, with the options of their training, or the authors'."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torch import Tensor, nn

from col3d import weights
from col3d.errors import UserError
from col3d.geometry import Camera
from col3d.geometry.camera_file import camera_from_plain
from col3d.layers.network import DepthNetwork
from col3d.layers.weight_file import check_finite, check_fractions
from col3d.models.build import build_network
from col3d.models.options import untrained
from col3d.models.published import load_published, read_weights
from col3d.runs.checkpoints import run_of
from col3d.runs.starts import Starts
from col3d.runs.trained import Trained, depth_seen, trained_options

MAX_DEPTH = 100.0
"""Largest depth in mm that the published programs for C3VD are trained with."""
SIZE = (320, 320)
"""Height and width of their input."""
SHIPPED = "shipped"
"""Stands for the small network that comes with the package, in place of a checkpoint's path. A file with this
name can be given by its absolute path."""
NETWORK = "network."
"""Prefix of the names of a network's weights in a checkpoint of `train.py`."""


@dataclass(frozen=True)
class TrainedNetwork:
    """The network of a checkpoint of `train.py`.

    Attributes:
        network: network in evaluation mode.
        trained: the options of its training.
        content: content of the checkpoint.
        cameras: cameras of the training frames, at their size; empty if unknown.
        depth_seen: sum of the training depths in mm, and their number.
    """

    network: nn.Module
    trained: Trained
    content: Mapping[str, Any]
    cameras: tuple[Camera, ...]
    depth_seen: Tensor


def trained_network(path: Path) -> TrainedNetwork:
    """Load the network of a checkpoint of `train.py`.

    Raises:
        UserError: it is no such checkpoint, damaged, or of another version.
    """
    checkpoint = read_file(path)
    _check_run(path, checkpoint)
    return network_of(checkpoint, path)


def network_of(checkpoint: Mapping[str, Any], path: Path) -> TrainedNetwork:
    """Build the network of a checkpoint of `train.py` that has been read.

    Raises:
        UserError: it is of no training, damaged, or of another version.
    """
    trained = trained_options(checkpoint, path)
    network = build_network(untrained(trained.model), trained.size_hw)
    seen = _fill(network, checkpoint, path)
    return TrainedNetwork(network.eval(), trained, checkpoint, _cameras(checkpoint, path), seen)


def _fill(network: nn.Module, checkpoint: Mapping[str, Any], path: Path) -> Tensor:
    """Load the network's weights, and return the sum and number of its training depths.

    Raises:
        UserError: tensors are not finite, or not those of the network.
    """
    whole = nn.ModuleDict({NETWORK.rstrip("."): network})
    try:
        given = {k: v for k, v in checkpoint["state_dict"].items() if str(k).startswith(NETWORK)}
        check_finite(given)
        seen = depth_seen(checkpoint)
        check_fractions(given, whole.state_dict())
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise UserError(f"checkpoint: {path}: {' '.join(str(error).split())}") from None
    try:
        whole.load_state_dict(given)
    except (KeyError, TypeError, RuntimeError) as error:
        reason = " ".join(str(error).split())
        raise UserError(f"checkpoint: {path} does not fit its own options: {reason[:300]}") from None
    return seen


def _cameras(checkpoint: Mapping[str, Any], path: Path) -> tuple[Camera, ...]:
    """Read the cameras of the training frames from a checkpoint; empty if it holds none."""
    about = checkpoint.get("about") or {}
    try:
        return tuple(camera_from_plain(plain) for plain in about.get("cameras", ()))
    except (AttributeError, TypeError, ValueError, ArithmeticError, RecursionError) as error:
        raise UserError(
            f"checkpoint: {path}: what it says about its cameras is not as train.py writes it ({error})"
        ) from None


def published_network(path: Path, source: str, max_depth: float | None = None) -> DepthNetwork:
    """Load the network of a checkpoint that the authors' program saved.

    Raises:
        UserError: it is no checkpoint of the authors.
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
    """Return the file of a checkpoint: the path itself, or that of the shipped network."""
    return Path(weights.__file__).with_name("shipped.ckpt") if str(checkpoint) == SHIPPED else checkpoint


def _check_run(path: Path, checkpoint: Mapping[str, Any]) -> None:
    """Refuse a checkpoint in the folder of a run that is of another run."""
    folder, run = path.absolute().parent, run_of(checkpoint)
    home = Starts(folder.parent).run if folder.name == "checkpoints" else ""
    if run is not None and home and run != home:
        raise UserError(
            f"checkpoint: {path} is of another run than {folder.parent}: put that run's own back, or copy "
            "this one to another place"
        )


def read_file(path: Path) -> dict[str, Any]:
    """Read a file of weights, after verifying it.

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
    """Verify the shipped checkpoint by its checksum."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise UserError(f"checkpoint: {path} of this package cannot be read ({error.strerror})") from None
    if hashlib.sha256(content).hexdigest() != weights.SHIPPED_SHA256:
        raise UserError(
            f"checkpoint: {path} is damaged: it is not the file of this package; install it again"
        )
