"""Metrics of other papers' evaluation programs, one value a frame."""

import functools

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from col3d.batch import check_maps
from col3d.metrics.functional.by_frame import by_frame

CM = 0.1
"""Centimetres of a millimetre."""
MEDIAN_EPSILON = 1e-3
"""Depth in mm that SimCol3D's program adds to the truth under a relative error."""


def literature_errors(
    preds: Float[Tensor, "b 1 h w"],
    target: Float[Tensor, "b 1 h w"],
    mask: Bool[Tensor, "b 1 h w"],
    epsilon: float = 0.0,
) -> dict[str, Float[Tensor, " b"]]:
    """Errors of depth as other programs compute them, in float64.

    silog_half: sqrt(mean g^2 - mean(g)^2 / 2) with g = log p - log t, of EndoStreamDepth. within_10_percent:
    the share of pixels with |p - t| / t < 0.1, which PPSNet calls a1. l1_cm, rmse_cm, and median_rel, the
    median of |p - t| / t in percent: of the SimCol3D challenge.

    Args:
        preds: predicted depth in mm.
        target: true depth in mm; anything where masked.
        mask: True where a pixel counts.
        epsilon: mm that are added to the truth in denominators, and to both in logarithms.

    Returns:
        Values by name, shape (b,); NaN for a frame of which no pixel counts.

    Raises:
        ValueError: the shapes do not belong together.

    References:
        Rau et al.: SimCol3D: 3D reconstruction during colonoscopy challenge, Medical Image Analysis 96,
        2024. Paruchuri et al.: PPSNet, ECCV 2024. Eigen, Puhrsch, Fergus, NeurIPS 2014, equation 4, for the
        logarithmic error with a half.
    """
    check_maps(preds, target, mask)
    return by_frame(functools.partial(_errors, epsilon), preds, target, mask)


def _errors(epsilon: float, preds: Tensor, target: Tensor, mask: Tensor) -> dict[str, Tensor]:
    frames = [
        _of_frame(guess[counts].double(), truth[counts].double(), epsilon)
        for guess, truth, counts in zip(preds, target, mask, strict=True)
    ]
    return {name: torch.stack([frame[name] for frame in frames]) for name in frames[0]}


def _of_frame(guess: Tensor, truth: Tensor, epsilon: float) -> dict[str, Tensor]:
    gap = guess - truth
    logs = (guess + epsilon).log() - (truth + epsilon).log()
    relative = 100 * gap.abs() / (truth + MEDIAN_EPSILON)
    return {
        "silog_half": (logs.square().mean() - logs.mean().square() / 2).clamp_min(0).sqrt(),
        "within_10_percent": (gap.abs() / (truth + epsilon) < 0.1).double().mean(),
        "l1_cm": CM * gap.abs().mean(),
        "median_rel": relative.quantile(0.5) if len(relative) else gap.sum() / 0,
        "rmse_cm": CM * gap.square().mean().sqrt(),
    }
