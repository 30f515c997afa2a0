"""Where the authors' numbers are, and their weights as the reference rule fills them.

The reference numbers are found through the environment variable COL3D_PARITY, the folder with `fill_rule.py`,
`state_dict_shapes.json` and one .npz per published network.
"""

import importlib.util
import json
import os
from functools import cache
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import torch
from torch import Tensor

PARITY = os.environ.get("COL3D_PARITY")
needs_parity = pytest.mark.skipif(PARITY is None, reason="COL3D_PARITY names no folder of reference numbers")
FILES = {
    "bts": "bts_resnet50",
    "newcrfs": "newcrfs_tiny07",
    "newcrfs_base": "newcrfs_base07",
    "monodepth_fpn": "monodepth_fpn_i2d_resnet101",
}
"""Names of the files, where they are not those of the sources."""


def folder() -> Path:
    assert PARITY is not None
    return Path(PARITY)


@cache
def rule() -> ModuleType:
    spec = importlib.util.spec_from_file_location("fill_rule", folder() / "fill_rule.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def published_shapes(source: str) -> dict[str, tuple[int, ...]]:
    shapes = json.loads((folder() / "state_dict_shapes.json").read_text())[FILES.get(source, source)]
    return {name: tuple(shape) for name, shape in shapes.items()}


@cache
def published_state(source: str) -> dict[str, Tensor]:
    """Filled tensors; integer ones are left out, as in the files that the rule makes."""
    integers = ("num_batches_tracked", "relative_position_index")
    shapes = {n: s for n, s in published_shapes(source).items() if not n.endswith(integers)}
    return {name: torch.from_numpy(rule().fill(name, shape)) for name, shape in shapes.items()}


def published_numbers(source: str) -> dict[str, Tensor]:
    with np.load(folder() / f"{FILES.get(source, source)}.npz") as stored:
        return {name: torch.from_numpy(stored[name]) for name in stored.files}


def network_input() -> Tensor:
    return torch.from_numpy(rule().network_input())
