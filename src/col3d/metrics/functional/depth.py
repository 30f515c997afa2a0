"""The nine depth metrics of the field, one value a frame."""

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from col3d.batch import check_maps

DEPTH_METRICS = ("abs_rel", "sq_rel", "log10", "rmse", "rmse_log", "silog", "delta1", "delta2", "delta3")
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
        min_depth: predictions are raised to this, so that their logarithm exists.
        max_depth: predictions are cut to this.

    Returns:
        Values by name, shape (b,); NaN for a frame of which no pixel counts.

    Raises:
        ValueError: the shapes do not belong together.

    References:
        Eigen, Puhrsch, Fergus: Depth Map Prediction from a Single Image using a Multi-Scale Deep Network,
        NeurIPS 2014, section 4.2.
    """
    check_maps(preds, target, mask)
    count = mask.sum(dim=(1, 2, 3), dtype=torch.float64)

    def mean(values: Tensor) -> Tensor:
        return torch.where(mask, values, 0.0).sum(dim=(1, 2, 3)) / count

    truth = torch.where(mask, target, 1.0).double()
    guess = torch.where(mask, preds, 1.0).double().clamp(min_depth, max_depth)
    gap, ratio = guess - truth, guess / truth
    log_ratio, worst = ratio.log(), torch.maximum(ratio, 1 / ratio)
    squared_log = mean(log_ratio.square())
    return {
        "abs_rel": mean(gap.abs() / truth),
        "sq_rel": mean(gap.square() / truth),
        "log10": mean(log_ratio.abs()) / torch.log(truth.new_tensor(10.0)),
        "rmse": mean(gap.square()).sqrt(),
        "rmse_log": squared_log.sqrt(),
        "silog": 100 * (squared_log - mean(log_ratio).square()).clamp_min(0).sqrt(),
        **{f"delta{k}": mean((worst < DELTA**k).double()) for k in (1, 2, 3)},
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
