"""Every network, as small as it gets, and laws that tests of single networks have in common."""

import torch
from torch import Tensor

from col3d.layers.network import DepthNetwork
from col3d.models import create

ENCODERS = {"newcrfs": "swin_tiny_patch4_window7_224", "pix2pix": "none"}


def small(name: str, **options: object) -> DepthNetwork:
    if name == "pix2pix":
        options["size_hw"] = (64, 64)
    return create(name, encoder=ENCODERS.get(name, "resnet18"), width=64, **options)


def depth_is_in_range(network: DepthNetwork, size_hw: tuple[int, int], max_depth: float) -> None:
    with torch.no_grad():
        depth = network.eval()(torch.rand(2, 3, *size_hw))["depth"]
    assert depth.shape == (2, 1, *size_hw)
    assert 0 < depth.min() <= depth.max() < max_depth


def normals_build_upon(network: DepthNetwork) -> None:
    """A decoder of normals takes the network's features and gives unit vectors."""
    network.add_normals(width=64)
    with torch.no_grad():
        normals = network.eval()(torch.rand(1, 3, 60, 70))["normals"]
    torch.testing.assert_close(normals.norm(dim=1), torch.ones(1, 60, 70))


def every_parameter_has_learned(network: DepthNetwork) -> None:
    """After a backward pass: each has a gradient, finite and somewhere not zero."""
    assert not [n for n, p in network.named_parameters() if p.grad is None or not p.grad.any()]
    assert all(p.grad is not None and p.grad.isfinite().all() for p in network.parameters())


def bfloat16_is_close(network: DepthNetwork, image: Tensor, mm: float) -> None:
    """Depth under autocast stays in float32, finite, and on average within that much of the exact one."""
    with torch.no_grad():
        exact = network.eval()(image)["depth"]
        with torch.autocast("cpu", torch.bfloat16):
            rough = network(image)["depth"]
    assert rough.dtype == torch.float32
    assert rough.isfinite().all()
    assert (rough - exact).abs().mean() < mm
