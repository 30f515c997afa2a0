"""Whether a file is an export of this program: the only kind of file that another export replaces."""

import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path

from col3d.inference.export.program_file import FACTS
from col3d.models.published import read_weights

OURS = "col3d"
OF_TRAINING = ("loops", "optimizer_states")
"""What a checkpoint of a training holds, and an export does not."""


def is_exported(path: Path) -> bool:
    """Whether a file was written by `col3d export`, by what it says of itself."""
    try:
        return SAYS[path.suffix](path)
    except Exception:  # whatever reading a file of something else may raise
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


SAYS: Mapping[str, Callable[[Path], bool]] = {".onnx": _onnx, ".pt2": _program, ".ckpt": _weights}
