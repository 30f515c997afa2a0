"""Averages over the pixels that count, and a square root that is differentiable at zero."""

import torch
from torch import Tensor


def masked_mean(values: Tensor, mask: Tensor) -> Tensor:
    """Mean over channels and the pixels where `mask` (b, 1, h, w) is True; zero where none is.

    Masked values may be anything, NaN included: they affect neither the mean nor the gradient.
    """
    kept = torch.where(mask, values, 0.0)
    count = mask.sum() * (values.shape[1] // mask.shape[1])
    return kept.sum() / count.clamp_min(1)


def root(value: Tensor) -> Tensor:
    """Square root of a scalar that is zero, with a zero gradient, at and below zero; NaN stays NaN."""
    nothing = value <= 0
    return torch.where(nothing, 0.0, torch.where(nothing, 1.0, value).sqrt())
