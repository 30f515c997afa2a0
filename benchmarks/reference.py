"""Reference numbers of the published programs, and their weights as the reference rule fills them.

They are found through the environment variable COL3D_PARITY, the folder with `fill_rule.py`,
`state_dict_shapes.json` and one .npz for each published network.
"""

import importlib.util
import json
import os
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from types import ModuleType

import numpy as np
import torch
from torch import Tensor

from col3d.errors import DataError

VARIABLE = "COL3D_PARITY"
FILES = {
    "bts": "bts_resnet50",
    "newcrfs": "newcrfs_tiny07",
    "newcrfs_base": "newcrfs_base07",
    "monodepth_fpn": "monodepth_fpn_i2d_resnet101",
}
"""Names of the files, where they are not those of the sources."""
INTEGERS = ("num_batches_tracked", "relative_position_index")


def folder() -> Path:
    """The folder of the reference numbers.

    Raises:
        DataError: the variable names none.
    """
    named = os.environ.get(VARIABLE, "")
    if not named or not Path(named).is_dir():
        raise DataError(f"{VARIABLE}: must name the folder of reference numbers, got {named!r}")
    return Path(named)


@cache
def rule() -> ModuleType:
    """The module that fills weights and images from their names and seeds."""
    spec = importlib.util.spec_from_file_location("fill_rule", folder() / "fill_rule.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def published_shapes(source: str) -> dict[str, tuple[int, ...]]:
    """Names and shapes of a published state dict."""
    shapes = json.loads((folder() / "state_dict_shapes.json").read_text())[FILES.get(source, source)]
    return {name: tuple(shape) for name, shape in shapes.items()}


@cache
def published_state(source: str) -> dict[str, Tensor]:
    """Filled tensors; integer ones are left out, as in the files that the rule makes."""
    shapes = {n: s for n, s in published_shapes(source).items() if not n.endswith(INTEGERS)}
    fill = rule().fill
    with ThreadPoolExecutor() as threads:  # numpy draws without holding Python's lock
        values = threads.map(fill, shapes, shapes.values())
        return {name: torch.from_numpy(value) for name, value in zip(shapes, values, strict=True)}


def published_numbers(source: str) -> dict[str, Tensor]:
    """What the published program computes from these weights and `network_input`."""
    with np.load(folder() / f"{FILES.get(source, source)}.npz") as stored:
        return {name: torch.from_numpy(stored[name]) for name in stored.files}


def network_input() -> Tensor:
    """The normalised image that the published program was given."""
    return torch.from_numpy(rule().network_input())
