"""A twin of the published Col3D-MTL, for timing alone: its operations one by one, on a network's own layers.

What it does literally: nearest up-sampling and then a convolution over four times the pixels; planes and
normals repeated to full size before anything is computed of them, one channel at a time; every input of a
convolution concatenated; the three axes of the normals one after another. The layers are those of the network
it is given, so the two share their weights, and must agree.
"""

import math

import torch
from torch import Tensor, nn

from col3d.batch import Prediction
from col3d.layers.cbam import CBAM
from col3d.layers.conv import UpConv, UpFuse
from col3d.layers.depth_decoder import DepthDecoder
from col3d.layers.normal_decoder import NormalDecoder
from col3d.models.col3d_mtl import Col3DMTL, published_normals

EPSILON = 1e-9
"""Added to a published denominator."""


class PublishedCol3D(nn.Module):
    """The published forward pass of a network with published heads.

    Args:
        network: made with `heads="published"`.
    """

    def __init__(self, network: Col3DMTL) -> None:
        super().__init__()
        self.network = network

    def forward(self, x: Tensor) -> Prediction:
        """A normalised image whose sides are multiples of 32 -> depth in mm, normals in published axes."""
        net = self.network
        assert net.normal_decoder is not None
        at2, at4, at8, at16, at32 = net.encoder(x)
        context = self._trunk(at8, at16, at32)
        depth = self._depth(net.depth_decoder, context, at2, at4)
        return {"depth": depth, "normals": self._normals(net.normal_decoder, context, at2, at4)}

    def _trunk(self, at8: Tensor, at16: Tensor, at32: Tensor) -> Tensor:
        trunk, aspp = self.network.trunk, self.network.trunk.aspp
        x = _fused(trunk.up16, torch.relu(at32), at16)
        concat = torch.cat([_risen(trunk.up8, x), at8], dim=1)
        fused = trunk.norm(_conv_elu(trunk.up8.fuse, concat))
        found = [aspp.branches[0](fused)]
        for branch in list(aspp.branches)[1:]:
            concat = torch.cat([concat, found[-1]], dim=1)
            found.append(branch(concat))
        return _conv_elu(aspp.fuse, torch.cat([fused, *found], dim=1))

    def _depth(self, decoder: DepthDecoder, x: Tensor, at2: Tensor, at4: Tensor) -> Tensor:
        x = _attended(decoder.attend8, x)
        at8_scaled = self._plane(_reduced(decoder.plane8.reduction, x), 8)
        shrunk = nn.functional.interpolate(at8_scaled, scale_factor=0.25, mode="nearest")
        x = _fused(decoder.up4, x, _attended(decoder.attend_skip4, at4), shrunk)
        x = _attended(decoder.attend4, x)
        at4_scaled = self._plane(_reduced(decoder.plane4.reduction, x), 4)
        shrunk = nn.functional.interpolate(at4_scaled, scale_factor=0.5, mode="nearest")
        x = _fused(decoder.up2, x, _attended(decoder.attend_skip2, at2), shrunk)
        x = _attended(decoder.attend2, x)
        at2_scaled = self._plane(_reduced(decoder.plane2.reduction, x), 2)
        x = _up(decoder.up1, x)
        finest = torch.sigmoid(_reduced(decoder.finest.get_submodule("reduction"), x))
        sum_of_normal = _normal(finest).sum(dim=1, keepdim=True)
        at1_scaled = finest[:, 2:] / (sum_of_normal + EPSILON)
        x = _conv_elu(decoder.fuse, torch.cat([x, at1_scaled, at2_scaled, at4_scaled, at8_scaled], dim=1))
        return decoder.max_depth * torch.sigmoid(decoder.head(x))

    def _plane(self, reduced: Tensor, patch: int) -> Tensor:
        """Planes of cells -> their depth at every pixel over the maximum depth."""
        unit, max_depth = torch.sigmoid(reduced), self.network.depth_decoder.max_depth
        normal = nn.functional.normalize(_normal(unit), dim=1)
        plane = torch.cat([normal, unit[:, 2:] * max_depth], dim=1)
        full = plane.repeat_interleave(patch, dim=2).repeat_interleave(patch, dim=3)
        n1, n2, n3, n4 = full[:, 0], full[:, 1], full[:, 2], full[:, 3]
        batch, _, height, width = reduced.shape
        places = torch.arange(patch, dtype=full.dtype, device=full.device).reshape(1, 1, patch)
        u = (places.repeat(batch, patch * height, width) - (patch - 1) * 0.5) / patch
        places = places.reshape(1, patch, 1)
        v = (places.repeat(batch, height, patch * width) - (patch - 1) * 0.5) / patch
        depth = n4 / (n1 * u + n2 * v + n3 + EPSILON)
        return depth.unsqueeze(1) / max_depth

    def _normals(self, decoder: NormalDecoder, x: Tensor, at2: Tensor, at4: Tensor) -> Tensor:
        normal8 = _repeated(_normal(torch.sigmoid(_reduced(decoder.normal8.reduction, x))), 8)
        shrunk = nn.functional.interpolate(normal8, scale_factor=0.25, mode="nearest")
        x = _fused(decoder.up4, x, at4, shrunk)
        normal4 = _repeated(_normal(torch.sigmoid(_reduced(decoder.normal4.reduction, x))), 4)
        shrunk = nn.functional.interpolate(normal4, scale_factor=0.5, mode="nearest")
        x = _fused(decoder.up2, x, at2, shrunk)
        normal2 = _repeated(_normal(torch.sigmoid(_reduced(decoder.normal2.reduction, x))), 2)
        x = _up(decoder.up1, x)
        normal1 = _normal(torch.sigmoid(_reduced(decoder.normal1.reduction, x)))
        raw = []
        for i, axis in enumerate("xyz"):
            own = [normals[:, i : i + 1] for normals in (normal1, normal2, normal4, normal8)]
            raw.append(decoder.head[axis](_conv_elu(decoder.fuse[axis], torch.cat([x, *own], dim=1))))
        return published_normals(torch.cat(raw, dim=1))


def _up(up: UpConv, x: Tensor) -> Tensor:
    return nn.functional.elu(up.conv(nn.functional.interpolate(x, scale_factor=2, mode="nearest")))


def _risen(step: UpFuse, x: Tensor) -> Tensor:
    risen: Tensor = step.norm(_up(step.up, x))
    return risen


def _fused(step: UpFuse, x: Tensor, *skips: Tensor) -> Tensor:
    return _conv_elu(step.fuse, torch.cat([_risen(step, x), *skips], dim=1))


def _conv_elu(block: nn.Module, x: Tensor) -> Tensor:
    return nn.functional.elu(block.get_submodule("0")(x))


def _reduced(reduction: nn.Module, x: Tensor) -> Tensor:
    *steps, last = reduction.children()
    for step in steps:
        x = _conv_elu(step, x)
    reduced: Tensor = last(x)
    return reduced


def _attended(attention: nn.Module, x: Tensor) -> Tensor:
    assert isinstance(attention, CBAM)
    mlp = attention.channel.mlp
    mean = mlp(nn.functional.adaptive_avg_pool2d(x, 1))
    x = x * torch.sigmoid(mean + mlp(nn.functional.adaptive_max_pool2d(x, 1)))
    pooled = torch.cat([x.mean(dim=1, keepdim=True), x.max(dim=1, keepdim=True)[0]], dim=1)
    return x * torch.sigmoid(attention.spatial.conv(pooled))


def _normal(unit: Tensor) -> Tensor:
    """Polar angle and azimuth as shares of 60 and 360 degrees -> the unit vector."""
    theta, phi = unit[:, 0] * math.pi / 3, unit[:, 1] * math.pi * 2
    n1 = torch.mul(torch.sin(theta), torch.cos(phi)).unsqueeze(1)
    n2 = torch.mul(torch.sin(theta), torch.sin(phi)).unsqueeze(1)
    return torch.cat([n1, n2, torch.cos(theta).unsqueeze(1)], dim=1)


def _repeated(normals: Tensor, patch: int) -> Tensor:
    return normals.repeat_interleave(patch, dim=2).repeat_interleave(patch, dim=3)
