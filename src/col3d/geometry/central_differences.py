"""Normals by central differences, with a backward pass that stores only the inputs."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.autograd.function import once_differentiable

TINY = 1e-24
"""Squared length below which a vector has no direction: its power of -3/2, in the gradient, fits float32."""


def central_normals(
    depth: Float[Tensor, "b 1 h w"], at_one: Float[Tensor, "#b 3 h w"], known: Bool[Tensor, "b 1 h w"]
) -> Float[Tensor, "b 3 h w"]:
    """Unit normals P_v x P_u of the points P = depth * at_one; zero where a derivative is unknown.

    Derivatives are sums of the forward and backward differences between known pixels. Differentiable in the
    depth, once: the backward pass recomputes the forward one. CPUs take frame by frame, so that intermediate
    results stay in the cache.

    Args:
        depth: depth along the optical axis, in float32 or float64; anything where it is not known.
        at_one: rays scaled to depth 1.
        known: pixels that count.
    """
    normals: Tensor = _CentralNormals.apply(depth, at_one, known)
    return normals


class _CentralNormals(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, depth: Tensor, at_one: Tensor, known: Tensor) -> Tensor:
        ctx.save_for_backward(depth, at_one, known)
        normals = depth.new_empty(len(depth), 3, *depth.shape[2:])
        for i in _parts(depth):
            normals[i] = _surface(depth[i], _of(at_one, i), known[i]).normals
        return normals

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, upstream: Tensor) -> tuple[Tensor, None, None]:
        depth, at_one, known = ctx.saved_tensors
        gradient = torch.empty_like(depth)
        for i in _parts(depth):
            rays = _of(at_one, i)
            surface = _surface(depth[i], rays, known[i])
            point_gradient = _to_points(upstream[i], surface)
            gradient[i] = _dot(point_gradient, rays).mul_(surface.known)
        return gradient, None, None


class _Surface(NamedTuple):
    """Intermediate results of both passes; masks are 1 where known, else 0."""

    normals: Tensor
    per_length: Tensor
    """1 over the length of P_v x P_u; 0 where there is no normal."""
    along_u: Tensor
    along_v: Tensor
    known: Tensor
    pairs_u: Tensor
    pairs_v: Tensor


def _surface(depth: Tensor, at_one: Tensor, known: Tensor) -> _Surface:
    solid = known.to(depth.dtype)
    points = torch.where(known, depth, 1.0) * at_one
    pairs_u, pairs_v = (_later(solid, dim) * _earlier(solid, dim) for dim in (-1, -2))
    along_u, along_v = _tangent(points, pairs_u, -1), _tangent(points, pairs_v, -2)
    across = _cross(along_v, along_u)
    squared = _dot(across, across)
    has_both = known & (_spread(pairs_u, -1) > 0) & (_spread(pairs_v, -2) > 0)
    per_length = torch.where(has_both & ~(squared <= TINY), squared.rsqrt(), 0.0)  # NaN stays NaN
    return _Surface(across.mul_(per_length), per_length, along_u, along_v, solid, pairs_u, pairs_v)


def _to_points(upstream: Tensor, surface: _Surface) -> Tensor:
    """Gradient by the points, from that by the normals."""
    normals, per_length, along_u, along_v = surface[:4]
    cross_gradient = torch.addcmul(upstream, normals, _dot(normals, upstream), value=-1).mul_(per_length)
    point_gradient = torch.zeros_like(normals)
    for tangent_gradient, pairs, dim in (
        (_cross(cross_gradient, along_v), surface.pairs_u, -1),
        (_cross(along_u, cross_gradient), surface.pairs_v, -2),
    ):
        step_gradient = (_later(tangent_gradient, dim) + _earlier(tangent_gradient, dim)).mul_(pairs)
        _later(point_gradient, dim).add_(step_gradient)
        _earlier(point_gradient, dim).sub_(step_gradient)
    return point_gradient


def _tangent(points: Tensor, pairs: Tensor, dim: int) -> Tensor:
    return _spread((_later(points, dim) - _earlier(points, dim)).mul_(pairs), dim)


def _spread(steps: Tensor, dim: int) -> Tensor:
    """Add each value between two pixels to both of them."""
    shape = list(steps.shape)
    shape[dim] += 1
    total = steps.new_zeros(shape)
    _earlier(total, dim).copy_(steps)
    _later(total, dim).add_(steps)
    return total


def _cross(a: Tensor, b: Tensor) -> Tensor:
    product = torch.empty_like(a)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        torch.mul(a[:, j], b[:, k], out=product[:, i]).addcmul_(a[:, k], b[:, j], value=-1)
    return product


def _dot(a: Tensor, b: Tensor) -> Tensor:
    total = a[:, :1] * b[:, :1]
    return total.addcmul_(a[:, 1:2], b[:, 1:2]).addcmul_(a[:, 2:], b[:, 2:])


def _later(values: Tensor, dim: int) -> Tensor:
    return values.narrow(dim, 1, values.shape[dim] - 1)


def _earlier(values: Tensor, dim: int) -> Tensor:
    return values.narrow(dim, 0, values.shape[dim] - 1)


def _parts(batch: Tensor) -> Iterator[slice]:
    """Slices of a batch that are computed at once: one frame on CPUs, else all."""
    size = 1 if batch.device.type == "cpu" else len(batch)
    return (slice(start, start + size) for start in range(0, len(batch), max(size, 1)))


def _of(shared: Tensor, part: slice) -> Tensor:
    return shared if len(shared) == 1 else shared[part]
