"""Inverse of an increasing function, by a table and Newton's method."""

from collections.abc import Callable

import torch
from torch import Tensor

ENTRIES = 4096
STEPS = 8
Function = Callable[[Tensor], Tensor]


def inverse(function: Function, slope: Function, limit: float, values: Tensor) -> Tensor:
    """Solve function(x) = value for x in [0, limit], in float64; differentiable; NaN without a solution.

    Newton's method stays in the table's interval that contains the root, so that it converges up to the
    limit, where the slope may be zero.

    Args:
        function: strictly increasing from 0 to the limit, and 0 at 0.
        slope: derivative of the function.
        limit: end of the interval, where the function stops growing.
        values: values of the function, of any range.
    """
    values = values.double()
    with torch.no_grad():
        grid = torch.linspace(0, limit, ENTRIES + 1, dtype=torch.float64, device=values.device)
        table = function(grid)
        above = torch.searchsorted(table, values.detach().contiguous()).clamp(1, ENTRIES)
        low, high = grid[above - 1], grid[above]
        share = (values - table[above - 1]) / (table[above] - table[above - 1]).clamp_min(1e-300)
        x = low + share.clamp(0, 1) * (high - low)
        for _ in range(STEPS):
            x = (x - _step(function, slope, x, values)).clamp(low, high)
    x = x - _step(function, slope, x, values)
    outside = (values < 0) | (values > table[-1])
    return torch.where(outside, torch.nan, x)


def _step(function: Function, slope: Function, x: Tensor, values: Tensor) -> Tensor:
    steep = slope(x)
    flat = steep < 1e-9
    return torch.where(flat, 0.0, (function(x) - values) / torch.where(flat, 1.0, steep))
