"""Normals of a depth map, and angles between vectors."""

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from col3d.geometry.camera import MIN_AHEAD
from col3d.geometry.central_differences import TINY, central_normals
from col3d.geometry.precision import at_least_float32
from col3d.nearest_names import check_known

DIFFERENCES = ("central", "forward")


def unit(vectors: Float[Tensor, "*b 3 h w"]) -> Float[Tensor, "*b 3 h w"]:
    """Normalise vectors to unit length; the zero vector (and its gradient) stays zero, NaN stays NaN."""
    squared = vectors.square().sum(dim=-3, keepdim=True)
    zero = squared <= TINY
    return torch.where(zero, 0.0, vectors * torch.where(zero, 1.0, squared).rsqrt())


def unit_in_place(vectors: Float[Tensor, "3 h w"]) -> Float[Tensor, "3 h w"]:
    """Normalise vectors without a gradient in place, several times as fast as `unit`."""
    squared = vectors[0].square().addcmul_(vectors[1], vectors[1]).addcmul_(vectors[2], vectors[2])
    return vectors.mul_(squared.clamp_min_(TINY).rsqrt_())


def normals_from_depth(
    depth: Float[Tensor, "b 1 h w"],
    rays: Float[Tensor, "*b 3 h w"],
    mask: Bool[Tensor, "b 1 h w"] | None = None,
    differences: str = "central",
) -> Float[Tensor, "b 3 h w"]:
    """Unit normals of the surface that a depth map describes, facing the camera; differentiable in depth.

    n = P_v x P_u with the derivatives of the points along rows and columns: central differences, one-sided
    beside a masked pixel or the border. Computed in float32 at least, whatever the autocast.

    Forward differences are those of the Col3D-MTL paper: Z_u = Z(u + 1) - Z(u), and P_u = Z_u r + Z r_u with
    the ray r at depth 1. They are undefined in the last row and column, and shift the normal by half a pixel.

    Args:
        depth: depth along the optical axis, in mm; masked values may be anything, NaN included.
        rays: unit rays of the camera that took the frame, one map for all frames or one for each.
        mask: True where depth is known; everywhere when absent.
        differences: "central" or "forward".

    Raises:
        ValueError: `differences` is neither.

    Returns:
        Normals with n . ray < 0; the zero vector where the mask is False or no neighbour is known in a row
        or column.

    References:
        Nakagawa, Uchiyama, Nagahara, Taniguchi: Estimating Surface Normals with Depth Image Gradients for
        Fast and Accurate Registration, 3DV 2015; with the derivatives taken of the ray map, so that any
        central camera serves. (The pinhole form printed in the Col3D-MTL paper writes dY/dx with
        x - cx and dZ/dy; it has to be (y - cy) / f dZ/dx.)
    """
    with torch.autocast(depth.device.type, enabled=False):
        ahead = rays.narrow(-3, 2, 1) > MIN_AHEAD
        known = ahead.expand_as(depth) if mask is None else mask & ahead
        depth = at_least_float32(depth)
        ahead_rays = torch.where(ahead, rays.to(depth.dtype), 1.0)
        at_one = ahead_rays / ahead_rays.narrow(-3, 2, 1)
        if check_known("differences", differences, DIFFERENCES) == "central":
            return central_normals(depth, at_one if at_one.ndim == 4 else at_one[None], known)
        safe = torch.where(known, depth, 1.0)
        along_u, has_u = _forward(safe, at_one, known, -1)
        along_v, has_v = _forward(safe, at_one, known, -2)
        normals = unit(torch.linalg.cross(along_v, along_u, dim=-3))
        return torch.where(known & has_u & has_v, normals, 0.0)


def _forward(depth: Tensor, at_one: Tensor, known: Tensor, dim: int) -> tuple[Tensor, Tensor]:
    """Forward differences of points by the product rule, and the pixels that have a next pixel."""
    has = known & torch.cat([known.narrow(dim, 1, known.shape[dim] - 1), _last(known, dim) & False], dim)
    slope = torch.cat([depth.diff(dim=dim), torch.zeros_like(_last(depth, dim))], dim)
    turn = torch.cat([at_one.diff(dim=dim), torch.zeros_like(_last(at_one, dim))], dim)
    return torch.where(has, slope, 0.0) * at_one + depth * turn, has


def _last(values: Tensor, dim: int) -> Tensor:
    return values.narrow(dim, values.shape[dim] - 1, 1)


def angle_between(a: Float[Tensor, "*b 3 h w"], b: Float[Tensor, "*b 3 h w"]) -> Float[Tensor, "*b 1 h w"]:
    """Angle between vectors in degrees: atan2(|a x b|, a . b); 0 where one is zero.

    For vectors of any length from 1e-8 to 1e8; exactly 0 and 180 degrees between equal and opposite ones,
    because each product of a x b is rounded by itself (`torch.linalg.cross` fuses them).
    """
    (ax, ay, az), (bx, by, bz) = a.split(1, dim=-3), b.split(1, dim=-3)
    crossed = (ay * bz - az * by).square() + (az * bx - ax * bz).square() + (ax * by - ay * bx).square()
    parallel = crossed == 0
    sine = torch.where(parallel, 0.0, torch.where(parallel, 1.0, crossed).sqrt())
    return torch.rad2deg(torch.atan2(sine, ax * bx + ay * by + az * bz))
