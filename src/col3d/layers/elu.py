"""In-place ELU by `exp`, which is faster than `expm1` on CPUs."""

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor, nn

BLOCK = 1 << 17
"""Number of values at a time: small enough to stay in the cache from step to step."""


class ELU(nn.Module):
    """`elu_` as a layer, for maps that nothing else reads, such as the result of a convolution."""

    def forward(self, x: Float[Tensor, "*n"]) -> Float[Tensor, "*n"]:
        """Apply ELU; the input is overwritten."""
        return elu_(x)


def elu_(x: Float[Tensor, "*n"]) -> Float[Tensor, "*n"]:
    """max(x, exp(min(x, 0)) - 1), written over `x`; only the result is kept for the gradient.

    torch's own kernel takes expm1, several times as slow on CPUs as exp in float32 and equal to within 6e-8.
    It is used on GPUs, where it is one kernel, in other precisions, and in exported networks.
    """
    if torch.compiler.is_exporting():
        return nn.functional.elu(x)
    if x.device.type != "cpu" or x.dtype != torch.float32:
        return nn.functional.elu(x, inplace=True)
    if torch.compiler.is_compiling():
        # not the maximum of both: beside 0 rounding would decide which of them has the gradient
        return torch.where(x > 0, x, x.clamp(max=0).exp() - 1)
    written: Tensor = _ELU.apply(x)
    return written


class _ELU(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor) -> Tensor:
        for block in _blocks(x):
            torch.maximum(block, block.clamp(max=0).exp_().sub_(1), out=block)
        ctx.mark_dirty(x)
        ctx.save_for_backward(x)
        return x

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> Tensor:
        (out,), (gradient,) = ctx.saved_tensors, gradients
        slope = torch.empty_like(out)
        if gradient.stride() != out.stride():
            gradient = torch.empty_like(out).copy_(gradient)
        for block, own, given in zip(_blocks(slope), _blocks(out), _blocks(gradient), strict=True):
            torch.clamp(own, max=0, out=block).add_(1).mul_(given)  # out + 1 below 0, and 1 above
        return slope


def _blocks(x: Tensor) -> tuple[Tensor, ...]:
    """The values of a tensor in the order of memory, in blocks; in one where memory has gaps."""
    if x.stride() != torch.empty_like(x, device="meta").stride():
        return (x,)
    return x.as_strided((x.numel(),), (1,)).split(BLOCK)
