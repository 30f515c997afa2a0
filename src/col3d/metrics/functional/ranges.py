"""Errors of depth in three ranges of true depth, one value a frame."""

import functools

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from col3d.batch import check_maps
from col3d.metrics.functional.by_frame import by_frame
from col3d.metrics.functional.depth import DELTA
from col3d.registry.metric_specs import RANGES


def range_errors(
    preds: Float[Tensor, "b 1 h w"],
    target: Float[Tensor, "b 1 h w"],
    mask: Bool[Tensor, "b 1 h w"],
    min_depth: float = 1e-3,
    max_depth: float = float("inf"),
) -> dict[str, Float[Tensor, " b"]]:
    """abs_rel, rmse and mae (mm) and delta1 of near, middle and far pixels, by their true depth.

    Near is below 30 mm, far is 70 mm and beyond, as EndoStreamDepth splits C3VD. That program counts 0 for a
    frame without a pixel in a range; here such a frame has no value.

    Args:
        preds: predicted depth in mm.
        target: true depth in mm; anything where masked.
        mask: True where a pixel counts.
        min_depth: lower bound that predictions are clipped to.
        max_depth: upper bound that predictions are clipped to.

    Returns:
        `near_abs_rel` and so on, shape (b,), float64; NaN for a frame without a pixel in the range.

    Raises:
        ValueError: the shapes do not belong together.
    """
    check_maps(preds, target, mask)
    return by_frame(functools.partial(_errors, min_depth, max_depth), preds, target, mask)


def _errors(
    min_depth: float, max_depth: float, preds: Tensor, target: Tensor, mask: Tensor
) -> dict[str, Tensor]:
    truth = torch.where(mask, target, 1.0).double()
    guess = torch.where(mask, preds.double().clamp(min_depth, max_depth), 1.0)
    gap = (guess - truth).abs()
    ratio = guess / truth
    close = torch.maximum(ratio, ratio.reciprocal()) < DELTA
    maps = {"abs_rel": gap / truth, "rmse": gap.square(), "mae": gap, "delta1": close.double()}
    inside = [mask & (target >= low) & (target < high) for low, high in RANGES.values()]
    parts = torch.cat(inside, dim=1).flatten(2).double()
    sums = torch.cat([*maps.values()], dim=1).flatten(2) @ parts.mT  # for each frame, by metric and range
    means = sums / parts.sum(dim=2)[:, None]
    values = {
        f"{part}_{name}": means[:, i, j] for j, part in enumerate(RANGES) for i, name in enumerate(maps)
    }
    return {name: mean.sqrt() if name.endswith("_rmse") else mean for name, mean in values.items()}
