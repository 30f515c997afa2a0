"""A checkpoint that holds a network alone, in half precision: to predict with, not to train on."""

from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from col3d.app.learnt import Learnt, learnt, trained_task
from col3d.app.same_outputs import phantom_frame
from col3d.app.traced import sample
from col3d.checks import UserError

SAME = 2e-2
"""Largest relative difference of depth that rounding the weights may make."""
KEPT = ("command", "commit", "versions", "cameras", "frames", "split", "metrics")
"""What stays of what a checkpoint says about itself."""


def write_weights(source: Path, path: Path) -> float:
    """Write the network of a checkpoint of `train.py` without what only its training needs.

    Returns:
        The largest relative difference of its depth from the original's, on a frame of the phantom.

    Raises:
        UserError: the source is no such checkpoint, or rounding changes what the network says.
    """
    task, options, checkpoint = trained_task(source)
    root = f"data/{Path(options.data.root).name}"
    data = options.data.model_copy(update={"root": root, "test": None, "also": {}})
    about = checkpoint.get("about") or {}
    content: dict[str, Any] = {
        "state_dict": {name: _halved(values) for name, values in task.state_dict().items()},
        "hyper_parameters": {"options": options.model_copy(update={"data": data}).model_dump()},
        "about": {name: about[name] for name in KEPT if name in about},
    }
    torch.save(content, path)
    difference = _difference(learnt(source), learnt(path))
    if not difference < SAME:
        raise UserError(
            f"export: half precision changes depth by {difference:.1%} of it; nothing was written"
        )
    return difference


def _halved(values: Tensor) -> Tensor:
    """Matrices and kernels; what is one number a channel costs little and stays."""
    return values.half() if values.is_floating_point() and values.ndim > 1 else values


@torch.inference_mode()
def _difference(whole: Learnt, rounded: Learnt) -> float:
    inputs = sample(whole.network, phantom_frame(whole.size_hw), next(iter(whole.cameras), None))
    depths = [one.network(**inputs)["depth"] for one in (whole, rounded)]
    return float(((depths[1] - depths[0]) / depths[0]).abs().max())
