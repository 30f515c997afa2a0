"""The nine depth metrics of the field, one value a frame."""

import functools
import math

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from col3d.batch import check_maps
from col3d.metrics.functional.by_frame import by_frame
from col3d.registry.metric_specs import PAPER_DEPTH

DEPTH_METRICS = tuple(spec.name for spec in PAPER_DEPTH)
DELTA = 1.25


def depth_metrics(
    preds: Float[Tensor, "b 1 h w"],
    target: Float[Tensor, "b 1 h w"],
    mask: Bool[Tensor, "b 1 h w"],
    min_depth: float = 1e-3,
    max_depth: float = float("inf"),
) -> dict[str, Float[Tensor, " b"]]:
    """Errors of depth in float64, one value a frame.

    abs_rel, sq_rel (mm), log10, rmse (mm), rmse_log (natural logarithm), silog (percent: 100 times the
    standard deviation of log p - log t) and delta1..3, the shares with max(p / t, t / p) < 1.25 ** k.

    Args:
        preds: predicted depth in mm.
        target: true depth in mm; anything where masked.
        mask: True where a pixel counts.
        min_depth: lower bound that predictions are clipped to, so that their logarithm exists.
        max_depth: upper bound that predictions are clipped to.

    Returns:
        Values by name, shape (b,); NaN for a frame of which no pixel counts.

    Raises:
        ValueError: the shapes do not belong together.

    References:
        Eigen, Puhrsch, Fergus: Depth Map Prediction from a Single Image using a Multi-Scale Deep Network,
        NeurIPS 2014, section 4.2.
    """
    check_maps(preds, target, mask)
    return by_frame(functools.partial(_errors, min_depth, max_depth, False, 0.0), preds, target, mask)


def depth_errors(
    preds: Float[Tensor, "b 1 h w"],
    target: Float[Tensor, "b 1 h w"],
    mask: Bool[Tensor, "b 1 h w"],
    min_depth: float = 1e-3,
    max_depth: float = float("inf"),
    epsilon: float = 0.0,
) -> dict[str, Float[Tensor, " b"]]:
    """The values of `depth_metrics`, and `mae`, the mean absolute error in mm.

    `epsilon`, in mm, is added to the truth in denominators, and to both in ratios and logarithms.
    """
    check_maps(preds, target, mask)
    return by_frame(functools.partial(_errors, min_depth, max_depth, True, epsilon), preds, target, mask)


def _errors(
    min_depth: float,
    max_depth: float,
    further: bool,
    epsilon: float,
    preds: Tensor,
    target: Tensor,
    mask: Tensor,
) -> dict[str, Tensor]:
    """Pixels that do not count are set to 1 mm in both, which changes no sum but those of shares."""
    count = mask.sum(dim=(1, 2, 3), dtype=torch.float64)
    others = mask[0].numel() - count

    def mean(values: Tensor) -> Tensor:
        return values.sum(dim=(1, 2, 3), dtype=torch.float64) / count

    truth = torch.where(mask, target, 1.0).double()
    guess = torch.where(mask, preds.double().clamp(min_depth, max_depth), 1.0)
    gap, under = guess - truth, truth + epsilon
    ratio = (guess + epsilon) / under
    squared, log_ratio = gap.square(), ratio.log()
    worst = torch.maximum(ratio, ratio.reciprocal())
    squared_log = mean(log_ratio.square())
    return {
        "abs_rel": mean(gap.abs() / under),
        "sq_rel": mean(squared / under),
        "log10": mean(log_ratio.abs()) / math.log(10),
        "rmse": mean(squared).sqrt(),
        "rmse_log": squared_log.sqrt(),
        "silog": 100 * (squared_log - mean(log_ratio).square()).clamp_min(0).sqrt(),
        **{f"delta{k}": ((worst < DELTA**k).sum(dim=(1, 2, 3)) - others) / count for k in (1, 2, 3)},
        **({"mae": mean(gap.abs())} if further else {}),
    }


def delta_share(
    preds: Float[Tensor, "b 1 h w"],
    target: Float[Tensor, "b 1 h w"],
    mask: Bool[Tensor, "b 1 h w"],
    threshold: float = DELTA,
) -> Float[Tensor, " b"]:
    """Share of the counting pixels with max(p / t, t / p) below a threshold, one value a frame."""
    check_maps(preds, target, mask)
    ratio = torch.where(mask, preds, 1.0).double() / torch.where(mask, target, 1.0).double()
    close = mask & (torch.maximum(ratio, 1 / ratio) < threshold)
    return close.sum(dim=(1, 2, 3), dtype=torch.float64) / mask.sum(dim=(1, 2, 3), dtype=torch.float64)
