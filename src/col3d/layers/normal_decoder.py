"""The decoder of surface normals (UNC blocks), for any network that offers maps at 1/2, 1/4 and 1/8."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor, nn

from col3d.geometry import camera_from_ray, ray_from_camera, unit
from col3d.geometry.precision import at_least_float32
from col3d.layers.conv import FuseELU, UpConv, UpFuse, init_xavier
from col3d.layers.planar import Reduction, sphere_normals, spherical

LEAST_FACING = 1e-3
"""Least ratio of a normal's part along minus its ray to its part across: at most 89.94 degrees off."""


class Features(NamedTuple):
    """Features of a depth network for a second decoder; a map that it lacks has no channels."""

    at2: Float[Tensor, "b _ h2 w2"]
    at4: Float[Tensor, "b _ h4 w4"]
    at8: Float[Tensor, "b _ h8 w8"]


@dataclass(frozen=True)
class NormalFrame:
    """Conversion of channels to unit normals in camera axes; each function also takes rays at its scale."""

    of_cell: Callable[[Tensor, Tensor | None], Tensor]
    """Two channels in (0, 1), polar angle and azimuth -> unit normals of cells."""
    as_input: Callable[[Tensor, Tensor | None], Tensor]
    """Unit normals -> the components that the next convolutions take as input."""
    of_pixel: Callable[[Tensor, Tensor | None], Tensor]
    """Three unbounded components -> unit normals of pixels."""
    needs_rays: bool = False


def _as_they_are(normals: Tensor, rays: Tensor | None) -> Tensor:
    return normals


def ray_normals(
    fractions: Float[Tensor, "b _ h w"], rays: Float[Tensor, "#b 3 h w"]
) -> Float[Tensor, "b 3 h w"]:
    """Unit normals that face the camera, from two channels in (0, 1): polar angle from -ray, azimuth.

    The polar angle is in [0, pi / 2): every surface that can be seen, and no other, wherever the ray points.
    """
    away = spherical(fractions[:, 0] * (math.pi / 2), fractions[:, 1] * (2 * math.pi))
    return camera_from_ray(torch.cat([away[:, :2], -away[:, 2:]], dim=1), rays)


def facing_normals(
    raw: Float[Tensor, "b 3 h w"], rays: Float[Tensor, "#b 3 h w"]
) -> Float[Tensor, "b 3 h w"]:
    """Unit normals that face the camera, from components in the ray's frame; the last through a softplus."""
    across = raw[:, :2]
    slack = LEAST_FACING * (1 + across.square().sum(dim=1, keepdim=True)).sqrt()
    towards = nn.functional.softplus(-raw[:, 2:]) + slack
    return camera_from_ray(unit(torch.cat([across, -towards], dim=1)), rays)


NORMAL_FRAMES = {
    "camera": NormalFrame(lambda two, _: sphere_normals(two), _as_they_are, lambda raw, _: unit(raw)),
    "ray": NormalFrame(ray_normals, ray_from_camera, facing_normals, needs_rays=True),  # type: ignore[arg-type]
}


class UnitNormal(nn.Module):
    """Unit normal computation (UNC): features -> one unit normal per cell, before it is repeated.

    Args:
        in_channels: channels that come in.
        first: channels after the first convolution of the reduction.
        frame: frame in which the two angles are measured.

    References:
        Chavarrias Solano et al., Multi-task learning with cross-task consistency for improved depth
        estimation in colonoscopy, arXiv:2311.18664, 2023, the framework's figure.
    """

    def __init__(self, in_channels: int, first: int, frame: NormalFrame) -> None:
        super().__init__()
        self.reduction = Reduction(in_channels, first, 2)
        self.frame = frame

    def forward(
        self, x: Float[Tensor, "b _ h w"], rays: Float[Tensor, "b 3 h w"] | None = None
    ) -> Float[Tensor, "b 3 h w"]:
        """A map, and the rays of its cells where the frame needs them -> unit normals of the same size."""
        reduced = self.reduction(x)
        with torch.autocast(x.device.type, enabled=False):
            return self.frame.of_cell(at_least_float32(reduced).sigmoid(), rays)


class NormalDecoder(nn.Module):
    """Unit normals at 1/8, 1/4, 1/2 and full size enter, axis by axis, the last convolutions.

    Args:
        channels: channels of the maps at 1/2, 1/4 and 1/8; 0 where the network has no such map.
        width: F; 512 is published.
        frame: conversion of channels to normals.
        bias: whether the last convolutions have biases; they then start near the normal (0, 0, -1).
    """

    def __init__(
        self, channels: tuple[int, int, int], width: int, frame: NormalFrame, bias: bool = True
    ) -> None:
        super().__init__()
        at2, at4, at8 = channels
        f4, f8, f16 = width // 4, width // 8, width // 16
        self.frame = frame
        self.normal8, self.up4 = UnitNormal(at8, f4, frame), UpFuse(at8, f4, at4 + 3)
        self.normal4, self.up2 = UnitNormal(f4, f8, frame), UpFuse(f4, f8, at2 + 3)
        self.normal2, self.up1 = UnitNormal(f8, f16, frame), UpConv(f8, f16)
        self.normal1 = UnitNormal(f16, f16 // 2, frame)
        self.fuse = nn.ModuleDict({axis: FuseELU(f16 + 4, f16) for axis in "xyz"})
        self.head = nn.ModuleDict({axis: nn.Conv2d(f16, 1, 3, padding=1, bias=bias) for axis in "xyz"})
        init_xavier(self)
        if bias:
            self._face_the_camera()

    def _face_the_camera(self) -> None:
        for head in self.head.values():
            nn.init.xavier_uniform_(head.get_parameter("weight"), gain=0.1)
        nn.init.constant_(self.head["z"].get_parameter("bias"), -1.0)

    def forward(
        self, features: Features, rays: Float[Tensor, "b 3 h w"] | None = None
    ) -> Float[Tensor, "b 3 h w"]:
        """The network's maps, and the rays where the frame needs them -> unit normals at full size."""
        at2, at4, x = features
        scale = {k: rays if rays is None else shrink_rays(rays, k) for k in (1, 2, 4, 8)}
        coarse8 = self.normal8(x, scale[8])
        x = self.up4(x, at4, self._as_input(coarse8, 2, scale[4]))
        coarse4 = self.normal4(x, scale[4])
        x = self.up2(x, at2, self._as_input(coarse4, 2, scale[2]))
        coarse2 = self.normal2(x, scale[2])
        x = self.up1(x)
        scales = [(self.normal1(x, rays), 1), (coarse2, 2), (coarse4, 4), (coarse8, 8)]
        return self.finish(x, [self._as_input(normals, factor, rays) for normals, factor in scales], rays)

    def finish(self, x: Tensor, scales: list[Tensor], rays: Tensor | None) -> Tensor:
        """Features and the normals of every scale, all at full size -> unit normals."""
        raw = [self._axis(axis, x, [s[:, i : i + 1] for s in scales]) for i, axis in enumerate("xyz")]
        return self.frame.of_pixel(torch.cat(raw, dim=1), rays)

    def _as_input(self, normals: Tensor, factor: int, rays: Tensor | None) -> Tensor:
        return self.frame.as_input(enlarge(normals, factor), rays)

    def _axis(self, axis: str, x: Tensor, components: list[Tensor]) -> Tensor:
        fused = self.fuse[axis](x, torch.cat(components, dim=1))
        with torch.autocast(x.device.type, enabled=False):
            raw: Tensor = self.head[axis](fused.to(self.head[axis].weight.dtype))
        return at_least_float32(raw)


def enlarge(x: Float[Tensor, "b c h w"], factor: int) -> Float[Tensor, "b c {factor}*h {factor}*w"]:
    """Nearest up-sampling: every value repeated over a `factor` x `factor` patch."""
    return x if factor == 1 else nn.functional.interpolate(x, scale_factor=factor, mode="nearest")


def shrink_rays(rays: Float[Tensor, "b 3 h w"], factor: int) -> Float[Tensor, "b 3 h2 w2"]:
    """The ray through the middle of every `factor` x `factor` patch."""
    return rays if factor == 1 else unit(nn.functional.avg_pool2d(rays, factor))
