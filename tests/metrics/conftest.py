"""Figures that programs of other papers gave."""

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor


@pytest.fixture(scope="module")
def literature() -> tuple[dict[str, Any], Tensor, Tensor]:
    """Figures; prediction and truth (7, 1, 60, 76) in mm, of which three frames are of one video."""
    folder = Path(os.environ["COL3D_PARITY"])
    maps = np.load(folder / "literature_inputs.npz")
    pred, truth = (torch.from_numpy(maps[name].astype(np.float32))[:, None] for name in ("pred", "truth"))
    return json.loads((folder / "literature.json").read_text()), pred, truth
