"""Local planar guidance: unit normals from angles, and the depth of a plane in each patch of pixels.

Everything here is computed in float32: the quotient of a ray and a plane loses its meaning in half precision.
"""

import math
from collections import OrderedDict

import torch
from jaxtyping import Float
from torch import Tensor, nn

from col3d.geometry.precision import at_least_float32
from col3d.layers.conv import conv_elu

SMALLEST_INCIDENCE = 1e-4


class Reduction(nn.Sequential):
    """1x1 convolutions with ELU that halve the channels from `first` down to 8, then one to `out_channels`.

    Args:
        in_channels: channels that come in.
        first: channels after the first convolution; below 8, only the last convolution remains.
        out_channels: channels of the result, which has no activation.
    """

    def __init__(self, in_channels: int, first: int, out_channels: int) -> None:
        steps: OrderedDict[str, nn.Module] = OrderedDict()
        while first >= 8:
            steps[f"to{first}"] = conv_elu(in_channels, first, kernel=1)
            in_channels, first = first, first // 2
        steps["out"] = nn.Conv2d(in_channels, out_channels, 1, bias=False)
        super().__init__(steps)


def spherical(theta: Float[Tensor, "b h w"], phi: Float[Tensor, "b h w"]) -> Float[Tensor, "b 3 h w"]:
    """Unit vector at polar angle `theta` from +z and azimuth `phi` from x to y, in radians."""
    sine = theta.sin()
    return torch.stack([sine * phi.cos(), sine * phi.sin(), theta.cos()], dim=1)


def cone_normals(unit: Float[Tensor, "b _ h w"]) -> Float[Tensor, "b 3 h w"]:
    """Unit vectors at most 60 degrees from +z, from two channels in (0, 1): polar angle, azimuth.

    References:
        Lee et al., From Big to Small, arXiv:1907.10326, 2019, section 3.2.
    """
    return spherical(unit[:, 0] * (math.pi / 3), unit[:, 1] * (2 * math.pi))


def sphere_normals(unit: Float[Tensor, "b _ h w"]) -> Float[Tensor, "b 3 h w"]:
    """Unit vectors anywhere on the sphere, from two channels in (0, 1): polar angle from -z, azimuth.

    The pole looks at the camera: a frontal plane has polar angle 0.
    """
    return spherical(math.pi * (1 - unit[:, 0]), unit[:, 1] * (2 * math.pi))


def intersect(distance: Tensor, incidence: Tensor) -> Tensor:
    """`distance / incidence`, kept finite where the ray runs inside the plane (incidence 0)."""
    smallest = torch.where(incidence < 0, -SMALLEST_INCIDENCE, SMALLEST_INCIDENCE)
    return distance / torch.where(incidence.abs() < SMALLEST_INCIDENCE, smallest, incidence)


def local_planar_guidance(
    normal: Float[Tensor, "b 3 h w"], distance: Float[Tensor, "b 1 h w"], patch: int
) -> Float[Tensor, "b 1 {patch}*h {patch}*w"]:
    """Depth of one plane per cell, at each pixel of the cell's patch: c = n4 / (n1 u + n2 v + n3).

    u and v are the pixel's place in its patch, (i - (k - 1) / 2) / k along the columns and the rows.

    Args:
        normal: unit normal (n1, n2, n3) of each cell's plane.
        distance: distance n4 of each plane, in any unit.
        patch: side k of the patch that a cell covers, in pixels.

    Returns:
        Depth in the unit of `distance`.

    References:
        Lee et al., From Big to Small, arXiv:1907.10326, 2019, section 3.2.
    """
    offset = (torch.arange(patch, device=normal.device, dtype=normal.dtype) - (patch - 1) / 2) / patch
    n1, n2, n3, n4 = torch.cat([normal, distance], dim=1)[:, :, :, None, :, None].unbind(dim=1)
    depth = intersect(n4, n1 * offset + n2 * offset.view(-1, 1, 1) + n3)
    return depth.flatten(3, 4).flatten(1, 2).unsqueeze(1)


class PlanarGuidance(nn.Module):
    """Features at 1/k -> depth at full size over the maximum depth, through one plane per cell."""

    def __init__(self, in_channels: int, first: int, patch: int) -> None:
        super().__init__()
        self.patch = patch
        self.reduction = Reduction(in_channels, first, 3)

    def forward(self, x: Float[Tensor, "b _ h w"]) -> Float[Tensor, "b 1 full_h full_w"]:
        """A map -> fraction of the maximum depth, mostly in (0, 1)."""
        reduced = self.reduction(x)
        with torch.autocast(x.device.type, enabled=False):
            unit = at_least_float32(reduced).sigmoid()
            return local_planar_guidance(cone_normals(unit), unit[:, 2:], self.patch)
