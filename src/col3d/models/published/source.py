"""Description of a published program's weights."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from torch import Tensor

from col3d.layers.network import DepthNetwork

Rules = dict[str, str]
"""Patterns in a name -> their replacements, applied in order."""


@dataclass(frozen=True)
class Source:
    """One published program: its network, and how its tensors are converted to ours."""

    network: Callable[..., DepthNetwork]
    rules: Rules
    """Rules from published names to this package's."""
    unused: str
    """Pattern of the tensors on which no output depends."""
    mark: str
    """Pattern of a name that only this program's weights have."""
    foreign: str | None
    """Pattern of names that its weights never have, where another program's weights also have the mark."""
    options: Callable[[Mapping[str, Tensor]], dict[str, Any]]
    """Published tensors -> options to build the network with."""
    adapt: Callable[[dict[str, Tensor]], list[str]] = lambda tensors: []
    """Changes renamed tensors in place, and returns the names of those that it cut."""
    normalised: bool = True
    """Whether the program normalises images with ImageNet's mean; else they are RGB in [0, 1] as they are."""


def our_name(name: str, rules: Rules) -> str:
    """Convert a published name to this package's.

    >>> our_name("decoder.bn5.weight", {r"^decoder.bn5": "trunk.up16.norm"})
    'trunk.up16.norm.weight'
    """
    for pattern, replacement in rules.items():
        name = re.sub(pattern, replacement, name)
    return name


def channels_of(tensors: Mapping[str, Tensor], pattern: str) -> int:
    """Output channels of the one convolution whose name fits a pattern.

    Raises:
        ValueError: there is none.
    """
    for name, tensor in tensors.items():
        if re.search(pattern, name) and tensor.ndim > 0:
            return len(tensor)
    raise ValueError(f"state_dict: lacks a tensor named as {pattern!r}, which tells the network's width")
