"""A network in half precision with inputs and outputs in single precision."""

import copy
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor, nn

from col3d.layers.conv import FuseELU, UpConv
from col3d.layers.network import needs_rays, predicts

CONVOLVING = (FuseELU, UpConv)
"""Blocks that use the weights of a layer inside them."""


class HalfNetwork(nn.Module):
    """A copy of a network with weights and maps between its layers in half precision.

    Sigmoids of depth and directions of normals, which a network always computes in single precision, stay so.
    """

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.network = copy.deepcopy(network).half()
        self.tasks, self.needs_rays = predicts(network), needs_rays(network)
        for module in self.network.modules():
            is_layer = not list(module.children()) and any(True for _ in module.parameters(recurse=False))
            if is_layer or isinstance(module, CONVOLVING):
                module.register_forward_pre_hook(_in_half)

    def forward(
        self, image: Float[Tensor, "b 3 h w"], rays: Float[Tensor, "*b 3 h w"] | None = None
    ) -> dict[str, Tensor]:
        """Predict, with results in single precision."""
        prediction = self.network(image.half(), rays)
        return {name: prediction[name].float() for name in self.tasks}


def _in_half(module: nn.Module, given: tuple[Any, ...]) -> tuple[Any, ...]:
    """Cast a layer's inputs to half: sigmoids and directions leave maps in single precision."""
    return tuple(x.half() if isinstance(x, Tensor) and x.dtype == torch.float32 else x for x in given)
