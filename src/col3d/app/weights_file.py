"""A checkpoint that holds a network alone, in half precision: to predict with, not to train on."""

from pathlib import Path
from typing import Any, TypeVar

import torch
from torch import Tensor

from col3d.app.checkpoints import CheckpointFiles
from col3d.app.learnt import Learnt, learnt, trained_task
from col3d.app.same_outputs import phantom_frame
from col3d.app.traced import sample
from col3d.checks import UserError
from col3d.data.options import SourceOptions
from col3d.models.options import untrained
from col3d.reports.places import command_without_places, last_name, without_places
from col3d.tasks.supervised import DEPTH_SEEN

SAME = 2e-2
"""Largest difference that rounding the weights may make: as a part of depth, in a component of normals."""
KEPT = ("command", "commit", "versions", "cameras", "frames", "split", "metrics")
"""What stays of what a checkpoint says about itself."""

Source = TypeVar("Source", bound=SourceOptions)


def write_weights(source: Path, path: Path) -> float:
    """Write the network of a checkpoint of `train.py` without what only its training needs.

    Paths in its options and in its command lose all but their last names: they are of the machine that
    trained.

    Returns:
        The largest difference from what the original says of a frame of the phantom; see `SAME`.

    Raises:
        UserError: the source is no such checkpoint, or rounding changes what the network says.
    """
    task, trained, checkpoint = trained_task(source)
    options = trained.options()
    data = _anywhere(options.data).model_copy(
        update={
            "also": {name: _anywhere(other) for name, other in options.data.also.items()},
            "test": options.data.test and _anywhere(options.data.test),
        }
    )
    elsewhere = {
        "data": data,
        "output_dir": f"runs/{last_name(options.output_dir)}",
        "model": untrained(options.model),
    }
    said = checkpoint.get("about")
    about = said if isinstance(said, dict) else {}
    kept = without_places({name: about[name] for name in KEPT if name in about})
    if isinstance(about.get("command"), str):
        kept["command"] = command_without_places(about["command"])
    content: dict[str, Any] = {
        "state_dict": {name: _halved(values) for name, values in task.state_dict().items()},
        DEPTH_SEEN: task.depth_seen,
        "epoch": checkpoint["epoch"],
        "hyper_parameters": {"options": without_places(options.model_copy(update=elsewhere).model_dump())},
        "about": kept,
    }
    CheckpointFiles().save_checkpoint(content, path)
    difference = _difference(learnt(source), learnt(path))
    if not difference < SAME:
        raise UserError(
            f"export: half precision changes what it says by {difference:.2g}; nothing was written"
        )
    return difference


def _anywhere(source: Source) -> Source:
    return source.model_copy(update={"root": f"data/{last_name(source.root)}", "store": "auto"})


def _halved(values: Tensor) -> Tensor:
    """Matrices and kernels; what is one number a channel costs little and stays."""
    return values.half() if values.is_floating_point() and values.ndim > 1 else values


@torch.inference_mode()
def _difference(whole: Learnt, rounded: Learnt) -> float:
    inputs = sample(whole.network, phantom_frame(whole.size_hw), next(iter(whole.cameras), None))
    before, after = whole.network(**inputs), rounded.network(**inputs)
    found = [((after["depth"] - before["depth"]) / before["depth"]).abs().max()]
    if "normals" in before:
        found.append((after["normals"] - before["normals"]).abs().max())
    return float(torch.stack(found).max())
