"""Recognition of files that `col3d export` wrote: an export replaces no others."""

import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path

from col3d.inference.export.program_file import FACTS
from col3d.models.published import read_weights

OURS = "col3d"
OF_TRAINING = ("loops", "optimizer_states")
"""Keys of a training's checkpoint that an export does not have."""


def is_exported(path: Path) -> bool:
    """Whether a file was written by `col3d export`, according to its content."""
    try:
        return CHECKS[path.suffix](path)
    except Exception:  # reading a file of another kind may raise anything
        return False


def _onnx(path: Path) -> bool:
    import onnx

    return bool(onnx.load(path, load_external_data=False).producer_name == OURS)


def _program(path: Path) -> bool:
    with zipfile.ZipFile(path) as archive:
        return any(name.endswith(f"/{FACTS}") for name in archive.namelist())


def _weights(path: Path) -> bool:
    content = read_weights(path)
    return {"about", "hyper_parameters", "state_dict"} <= content.keys() and not any(
        name in content for name in OF_TRAINING
    )


CHECKS: Mapping[str, Callable[[Path], bool]] = {".onnx": _onnx, ".pt2": _program, ".ckpt": _weights}
