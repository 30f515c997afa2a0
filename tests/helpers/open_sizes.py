"""Traces networks, in a process of its own, and holds them against themselves at sizes that nobody traced.

Tracing hands symbols to functions that the tests' type checks want whole numbers for.
"""

import torch
from small import small
from torch import Tensor

from col3d.inference.export.traced import sample, traced
from col3d.layers.network import DepthNetwork
from col3d.layers.normal_decoder import Features
from col3d.layers.window_attention import WindowBlock
from col3d.models.newcrfs import cell_means

SIZES = ((1, 64, 40), (3, 75, 101), (1, 500, 33))


class Windows(DepthNetwork):
    """What NeWCRFs does that hangs on the size, once instead of twenty times, which takes long to trace."""

    def __init__(self) -> None:
        super().__init__()
        self.block = WindowBlock(3, 1, shift=3)

    def estimate(self, x: Tensor) -> tuple[Tensor, Features]:
        coarse = torch.nn.functional.avg_pool2d(x, 16).permute(0, 2, 3, 1)
        seen = self.block(coarse).permute(0, 3, 1, 2)
        far = torch.nn.functional.interpolate(cell_means(seen, 6), size=x.shape[2:], mode="bilinear")
        near = torch.nn.functional.interpolate(seen, scale_factor=16, mode="nearest")
        return (far + near).mean(dim=1, keepdim=True), Features(x, x, x)


torch.manual_seed(0)
rays = {"normals": "unc", "normal_frame": "ray"}
for network in (Windows(), small("pix2pix", **rays), small("monodepth_fpn")):
    program = traced(network.eval().requires_grad_(False)).module(check_guards=False)
    for batch, height, width in SIZES:
        inputs = sample(network, torch.rand(batch, 3, height, width))
        expected, found = network(**inputs), program(*inputs.values())
        torch.testing.assert_close(found["depth"], expected["depth"], atol=1e-3, rtol=0)
        if network.needs_rays:
            torch.testing.assert_close(found["normals"], expected["normals"], atol=1e-4, rtol=0)
        print(type(network).__name__, batch, height, width)
