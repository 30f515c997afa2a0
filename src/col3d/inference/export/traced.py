"""A network as a graph, traced once, that holds for batches and images of any size."""

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.export import Dim, ExportedProgram, export

from col3d.geometry import Camera, OmnidirectionalCamera
from col3d.inference.export.half_precision import HalfNetwork
from col3d.layers.network import DepthNetwork, needs_rays, predicts

TRACED = (2, 250, 330)
"""Batch, height and width of the trace. At 1/32 NeWCRFs has several windows of it: what is one in a trace
counts as one for ever."""
LEAST_SIDE = 33
"""Pixels of a side from which a traced program is known to hold; below, a map at 1/32 has one row."""


@dataclass(frozen=True)
class Fixed:
    """What a program is bound to; None of what stays open.

    Attributes:
        batch: number of images.
        size_hw: their height and width.
    """

    batch: int | None = None
    size_hw: tuple[int, int] | None = None

    def shape(self, batch: int, height: int, width: int) -> tuple[int, int, int]:
        """A batch, height and width, as far as they are open."""
        return (self.batch or batch, *(self.size_hw or (height, width)))


ANY = Fixed()


def sample(network: nn.Module, image: Tensor, lens: Camera | None = None) -> dict[str, Tensor]:
    """The inputs of a network by name: images, and the rays of a lens where it needs them.

    Args:
        network: gives `needs_rays`.
        image: RGB in [0, 1], (b, 3, h, w).
        lens: at any size; C3VD's when absent.
    """
    if not needs_rays(network):
        return {"image": image}
    camera = (lens or OmnidirectionalCamera.c3vd()).resized((image.shape[2], image.shape[3]))
    return {"image": image, "rays": camera.rays()[None]}


def traced(network: nn.Module, fixed: Fixed = ANY) -> ExportedProgram:
    """The network, in evaluation mode on the CPU, as a program for images of any size, or of a fixed one.

    Layers take their plain forms where `torch.compiler.is_exporting()`.

    Args:
        network: as it is, or in half precision.
        fixed: batch, and height and width, that the program is bound to.
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
    """What a network predicts, without what else it returns."""

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.network = network

    def forward(self, image: Tensor, rays: Tensor | None = None) -> dict[str, Tensor]:
        """Predictions by name."""
        found = self.network(image, rays)
        return {name: found[name] for name in predicts(self.network)}


def _narrowed(network: nn.Module) -> nn.Module:
    """Networks of this package return nothing else, and keep the names of their weights."""
    return network if isinstance(network, DepthNetwork | HalfNetwork) else _Narrowed(network)
