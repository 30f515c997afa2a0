"""Tracing of a network to a graph that holds for batches and images of any size."""

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.export import Dim, ExportedProgram, export

from col3d.geometry import Camera, OmnidirectionalCamera
from col3d.inference.export.half_precision import HalfNetwork
from col3d.layers.network import DepthNetwork, needs_rays, predicts

TRACED = (2, 250, 330)
"""Batch, height and width of the trace. At 1/32 NeWCRFs has several windows at this size: a dimension of one
in a trace stays one."""
LEAST_SIDE = 33
"""Smallest side in pixels for which a traced program is known to hold; below, a map at 1/32 has one row."""


@dataclass(frozen=True)
class Fixed:
    """Dimensions that a program is bound to; None means any.

    Attributes:
        batch: number of images.
        size_hw: height and width of the images.
    """

    batch: int | None = None
    size_hw: tuple[int, int] | None = None

    def shape(self, batch: int, height: int, width: int) -> tuple[int, int, int]:
        """Return batch, height and width, with fixed dimensions in place of the given ones."""
        return (self.batch or batch, *(self.size_hw or (height, width)))


ANY = Fixed()


def sample(network: nn.Module, image: Tensor, lens: Camera | None = None) -> dict[str, Tensor]:
    """Make the inputs of a network by name: images, and the rays of a lens if it needs them.

    Args:
        network: the network, which may need rays.
        image: RGB in [0, 1], (b, 3, h, w).
        lens: lens at any size; C3VD's when absent.
    """
    if not needs_rays(network):
        return {"image": image}
    camera = (lens or OmnidirectionalCamera.c3vd()).resized((image.shape[2], image.shape[3]))
    return {"image": image, "rays": camera.rays()[None]}


def traced(network: nn.Module, fixed: Fixed = ANY) -> ExportedProgram:
    """Trace a network, in evaluation mode on the CPU, to a program for images of any or a fixed size.

    Layers use their plain forms if `torch.compiler.is_exporting()`.

    Args:
        network: the network, or its copy in half precision.
        fixed: batch, height and width that the program is bound to.
    """
    batch, height, width = fixed.shape(*TRACED)
    given = sample(network, torch.rand(batch, 3, height, width))
    open_sides = {} if fixed.size_hw else {2: Dim.DYNAMIC, 3: Dim.DYNAMIC}
    open_batch = {} if fixed.batch else {0: Dim.DYNAMIC}
    sizes = {"image": {**open_batch, **open_sides}, "rays": open_sides}
    return export(
        _narrowed(network),
        tuple(given.values()),
        dynamic_shapes=tuple(sizes[name] for name in given),
        strict=False,
    )


class _Narrowed(nn.Module):
    """Wraps a network to return only depth and normals."""

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.network = network

    def forward(self, image: Tensor, rays: Tensor | None = None) -> dict[str, Tensor]:
        """Predictions by name."""
        prediction = self.network(image, rays)
        return {name: prediction[name] for name in predicts(self.network)}


def _narrowed(network: nn.Module) -> nn.Module:
    """Wrap a network unless it is of this package, whose networks return nothing else.

    Unwrapped networks keep the names of their weights.
    """
    return network if isinstance(network, DepthNetwork | HalfNetwork) else _Narrowed(network)
