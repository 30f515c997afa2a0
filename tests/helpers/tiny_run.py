"""The smallest run that has every part, and where real frames are."""

import os
import zipfile
from pathlib import Path
from typing import Any

import onnx
import pytest
import torch
from tiny_options import SMALL, TINY

from col3d.cli import program

__all__ = ["SMALL", "TINY", "composed", "earlier_export", "real_frames"]


def composed(config_name: str, *overrides: str) -> dict[str, Any]:
    """The configuration as the programs hand it on."""
    return program.composed(config_name, overrides)


def real_frames(folder: str) -> Path:
    """A folder of real frames; the test is skipped where there are none."""
    sample = os.environ.get("COL3D_C3VD_SAMPLE")
    if not sample:
        pytest.skip("set COL3D_C3VD_SAMPLE to a folder of C3VD frames")
    return Path(sample) / folder


def earlier_export(path: Path) -> bytes:
    """Write what `col3d export` takes for an export of its own; what is in it."""
    if path.suffix == ".onnx":
        path.write_bytes(onnx.ModelProto(producer_name="col3d", ir_version=8).SerializeToString())
    elif path.suffix == ".pt2":
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("model/extra/col3d.json", "{}")
    else:
        torch.save({"state_dict": {}, "hyper_parameters": {}, "about": {}}, path)
    return path.read_bytes()
