"""Load weights that the authors' programs saved into the networks of this package."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from col3d.io.atomic import BUFFER
from col3d.layers.network import DepthNetwork
from col3d.layers.weight_file import check_archive, check_finite, check_fractions
from col3d.models import create
from col3d.models.published.bts_family import (
    BTS_CBAM_MTL_WEIGHTS,
    BTS_CBAM_WEIGHTS,
    BTS_WEIGHTS,
    COL3D_MTL_WEIGHTS,
)
from col3d.models.published.monodepth_fpn import MONODEPTH_FPN_WEIGHTS
from col3d.models.published.newcrfs import NEWCRFS_WEIGHTS
from col3d.models.published.source import Source, our_name
from col3d.nearest_names import check_known

SOURCES: dict[str, Source] = {
    "bts": BTS_WEIGHTS,
    "col3d_bts_cbam": BTS_CBAM_WEIGHTS,
    "col3d_mtl_no_xtc": BTS_CBAM_MTL_WEIGHTS,
    "col3d_mtl": COL3D_MTL_WEIGHTS,
    "newcrfs": NEWCRFS_WEIGHTS,
    "monodepth_fpn": MONODEPTH_FPN_WEIGHTS,
}
OURS = "network."
"""Prefix of names in checkpoints of this package's trainings."""
NUMPY_RECONSTRUCT, NUMPY_SCALAR = (value.__reduce__()[0] for value in (np.zeros(1), np.float64(0)))
"""Functions that pickles of arrays and of their scalars call."""
NUMPY_ARRAYS: list[Any] = [
    (NUMPY_RECONSTRUCT, "numpy.core.multiarray._reconstruct"),
    (NUMPY_RECONSTRUCT, "numpy._core.multiarray._reconstruct"),
    (NUMPY_SCALAR, "numpy.core.multiarray.scalar"),
    (NUMPY_SCALAR, "numpy._core.multiarray.scalar"),
    np.ndarray,
    np.dtype,
    *{type(np.dtype(kind)) for kind in ("bool", "int32", "int64", "float32", "float64")},
]
"""Safe globals of plain arrays, which the authors' programs store beside their weights."""


def load_published(
    source: str,
    state_dict: Mapping[str, Any],
    max_depth: float = 100.0,
) -> DepthNetwork:
    """Build a network with the authors' weights, in evaluation mode; it predicts in standard units.

    Encoder and width follow from the shapes of the tensors.

    Args:
        source: the program that saved the weights, one of `SOURCES`.
        state_dict: names to tensors, bare or under "model" or "state_dict", with or without "module."
            before each name. Integer tensors may be missing. A checkpoint of this package's training of
            that network serves as well.
        max_depth: the maximum depth that it was trained with, in mm.

    Returns:
        The network. `skipped_names` lists the tensors that were left out because no output depends on them.

    Raises:
        ValueError: the source is unknown, or weights are missing, foreign or of other shapes.
    """
    known = SOURCES[check_known("source", source, SOURCES)]
    if max_depth <= 0:
        raise ValueError(f"max_depth: expected mm above 0, got {max_depth}")
    tensors = tensors_of(state_dict)
    if any(name.startswith(OURS) for name in tensors):
        return _load_ours(source, tensors, state_dict)
    _check_method(source, tensors)
    network = known.network(max_depth=max_depth, **known.options(tensors))
    skipped = [name for name in tensors if re.search(known.unused, name)]
    published = {our_name(name, known.rules): name for name in tensors if name not in skipped}
    fitted = {standard: tensors[name] for standard, name in published.items()}
    skipped += [f"{published[name]}[2]" for name in known.adapt(fitted)]
    _fill(network, fitted, published)
    network.skipped_names = tuple(skipped)
    if not known.normalised:
        network.mean.zero_()
        network.std.fill_(1.0)
    return network.eval()


def read_weights(path: Path) -> dict[str, Any]:
    """Read a file of `torch.save` that holds only tensors and plain values.

    Raises:
        ValueError: there is no such file, or it holds anything else.
    """
    if not path.is_file():
        raise ValueError(f"checkpoint: no such file: {path}")
    try:
        check_archive(path)
    except ValueError as error:
        raise ValueError(f"checkpoint: {error}") from None
    try:
        with torch.serialization.safe_globals(NUMPY_ARRAYS), path.open("rb", buffering=BUFFER) as file:
            content = torch.load(file, map_location="cpu", weights_only=True)
    except Exception as error:  # a file that is no weights may fail in any way while it is read
        raise ValueError(
            f"checkpoint: {path} must hold tensors and plain values alone, as torch.save writes them; "
            f"it cannot be read as such ({type(error).__name__})"
        ) from None
    if not isinstance(content, dict):
        raise ValueError(f"checkpoint: {path} must map names to tensors; it holds a {type(content).__name__}")
    return content


def _load_ours(source: str, tensors: dict[str, Tensor], checkpoint: Mapping[str, Any]) -> DepthNetwork:
    """Load a checkpoint of this package, whose own options determine the network."""
    try:
        model = dict(checkpoint["hyper_parameters"]["options"]["model"]) | {"pretrained": None}
        network = create(**{k: v for k, v in model.items() if k not in ("freeze", "unfreeze_at")})
    except (KeyError, TypeError) as error:
        raise ValueError(
            f"state_dict: a checkpoint of train.py must hold the options of its network; {error}"
        ) from None
    if type(network) is not SOURCES[source].network or not isinstance(network, DepthNetwork):
        raise ValueError(f"state_dict: must hold weights of {source}; these are of {model['name']}")
    named = {name.removeprefix(OURS): name for name in tensors if name.startswith(OURS)}
    _fill(network, {name: tensors[full] for name, full in named.items()}, named)
    return network.eval()


def tensors_of(state_dict: Any) -> dict[str, Tensor]:
    """The tensors of a saved state dict, without the wrappers that programs put around them.

    Raises:
        ValueError: it holds no tensors by name.
    """
    if not isinstance(state_dict, Mapping):
        raise ValueError(f"state_dict: must map names to tensors, got a {type(state_dict).__name__}")
    for wrapper in ("model", "state_dict"):
        if isinstance(state_dict.get(wrapper), Mapping):
            state_dict = state_dict[wrapper]
    plain = all(isinstance(k, str) and isinstance(v, Tensor) for k, v in state_dict.items())
    if not state_dict or not plain:
        raise ValueError(
            "state_dict: must map names to tensors, itself or under 'model' or 'state_dict'; "
            f"it has {_some(list(map(str, state_dict))) or 'nothing'}"
        )
    return {name.removeprefix("module."): value for name, value in state_dict.items()}


def _check_method(source: str, tensors: Mapping[str, Tensor]) -> None:
    """Refuse the weights of another method."""

    def marked(known: Source) -> bool:
        foreign = known.foreign is not None and any(re.search(known.foreign, name) for name in tensors)
        return not foreign and any(re.search(known.mark, name) for name in tensors)

    if marked(SOURCES[source]):
        return
    others = [name for name, known in SOURCES.items() if marked(known)]
    actual = f"these are of {' or '.join(others)}" if others else f"it has {_some(list(tensors))}"
    raise ValueError(f"state_dict: must hold weights of {source}; {actual}")


def _fill(network: DepthNetwork, given: dict[str, Tensor], spelled: Mapping[str, str]) -> None:
    """Load tensors strictly; `spelled` gives the names that messages use.

    Raises:
        ValueError: tensors are missing, unknown or of other shapes.
    """
    wanted = network.state_dict()
    missing = [n for n in wanted if n not in given and wanted[n].is_floating_point()]
    foreign = [spelled[n] for n in given if n not in wanted]
    misfits = [
        f"{spelled[n]} {tuple(given[n].shape)} for {tuple(wanted[n].shape)}"
        for n in given
        if n in wanted and given[n].shape != wanted[n].shape
    ]
    for rule, names in (("has unknown", foreign), ("lacks", missing), ("has other shapes:", misfits)):
        if names:
            raise ValueError(f"state_dict: {rule} {_some(names)}")
    try:
        check_finite({spelled[n]: values for n, values in given.items()})
        check_fractions(given, wanted)
    except ValueError as error:
        raise ValueError(f"state_dict: {error}") from None
    network.load_state_dict(given, strict=False)


def _some(names: list[str], most: int = 5) -> str:
    return ", ".join(map(str, names[:most])) + (f" and {len(names) - most} more" if len(names) > most else "")
