"""Export of a checkpoint with only the network, in half precision, for prediction."""

from pathlib import Path
from typing import Any, TypeVar

import torch
from torch import Tensor

from col3d.data.options import SourceOptions
from col3d.errors import UserError
from col3d.inference.export.parity import phantom_frame
from col3d.inference.export.traced import sample
from col3d.inference.predictor import Predictor, load_predictor
from col3d.inference.trained_network import NETWORK, trained_network
from col3d.models.options import untrained
from col3d.reports.places import command_without_places, last_name, without_places
from col3d.runs.checkpoints import CheckpointFiles
from col3d.runs.trained import DEPTH_SEEN

SAME = 2e-2
"""Largest allowed difference from rounding the weights: relative in depth, in a component of normals."""
KEPT = ("command", "commit", "versions", "cameras", "frames", "split", "metrics")
"""Entries of a checkpoint's `about` that are kept."""

Source = TypeVar("Source", bound=SourceOptions)


def write_weights(source: Path, path: Path) -> float:
    """Write the network of a checkpoint of `train.py` without what only its training needs.

    Paths in its options and its command keep only their last names, because they are of the machine that
    trained.

    Returns:
        The largest difference from the original's prediction for a frame of the phantom; see `SAME`.

    Raises:
        UserError: the source is no such checkpoint, or rounding changes the prediction too much.
    """
    loaded = trained_network(source)
    trained, checkpoint = loaded.trained, loaded.content
    data = _anywhere(trained.data).model_copy(
        update={
            "also": {name: _anywhere(other) for name, other in trained.data.also.items()},
            "test": trained.data.test and _anywhere(trained.data.test),
        }
    )
    options = {
        **trained.content,
        "data": data.model_dump(),
        "output_dir": f"runs/{last_name(str(trained.content.get('output_dir', '')))}",
        "model": untrained(trained.model).model_dump(),
    }
    stored = checkpoint.get("about")
    about = stored if isinstance(stored, dict) else {}
    kept = without_places({name: about[name] for name in KEPT if name in about})
    if isinstance(about.get("command"), str):
        kept["command"] = command_without_places(about["command"])
    content: dict[str, Any] = {
        "state_dict": {f"{NETWORK}{name}": _halved(v) for name, v in loaded.network.state_dict().items()},
        DEPTH_SEEN: loaded.depth_seen,
        "epoch": checkpoint["epoch"],
        "hyper_parameters": {"options": without_places(options)},
        "about": kept,
    }
    CheckpointFiles().save_checkpoint(content, path)
    difference = _difference(load_predictor(source), load_predictor(path))
    if not difference < SAME:
        raise UserError(
            f"export: half precision changes what it says by {difference:.2g}; nothing was written"
        )
    return difference


def _anywhere(source: Source) -> Source:
    return source.model_copy(update={"root": f"data/{last_name(source.root)}", "store": "auto"})


def _halved(values: Tensor) -> Tensor:
    """Round matrices and kernels to half; vectors, which take little space, stay as they are."""
    return values.half() if values.is_floating_point() and values.ndim > 1 else values


@torch.inference_mode()
def _difference(whole: Predictor, rounded: Predictor) -> float:
    inputs = sample(whole.network, phantom_frame(whole.size_hw), next(iter(whole.cameras), None))
    before, after = whole.network(**inputs), rounded.network(**inputs)
    differences = [((after["depth"] - before["depth"]) / before["depth"]).abs().max()]
    if "normals" in before:
        differences.append((after["normals"] - before["normals"]).abs().max())
    return float(torch.stack(differences).max())
