"""The scale-invariant logarithmic error of depth."""

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from col3d.batch import check_maps
from col3d.geometry.precision import at_least_float32
from col3d.losses.masked import masked_mean, root

SMALLEST_DEPTH = 1e-6
"""Lower bound in mm of predictions in the logarithm: a sigmoid may underflow to zero."""


def silog(
    preds: Float[Tensor, "b 1 h w"],
    target: Float[Tensor, "b 1 h w"],
    mask: Bool[Tensor, "b 1 h w"],
    alpha: float = 10.0,
    variance_focus: float = 0.85,
    log_epsilon: float = 0.0,
) -> Float[Tensor, ""]:
    """Scale-invariant logarithmic error: alpha sqrt(mean(g^2) - variance_focus mean(g)^2), g = log p - log t.

    Args:
        preds: predicted depth in mm.
        target: true depth in mm; anything where masked.
        mask: True where a pixel counts; means are over all of the batch's counting pixels.
        alpha: scale of the loss.
        variance_focus: lambda of the paper, 1 for full invariance to scale. (The square that the paper's
            equation prints over lambda / N belongs to N.)
        log_epsilon: added to the prediction inside the logarithm; published code has 1e-3.

    Returns:
        A scalar; zero where nothing counts.

    Raises:
        ValueError: the shapes do not belong together.

    References:
        Eigen, Puhrsch, Fergus: Depth Map Prediction from a Single Image using a Multi-Scale Deep Network,
        NeurIPS 2014, eq. 4; Lee et al.: From Big to Small (BTS), 2019, eq. 5.
    """
    check_maps(preds, target, mask)
    preds, target = at_least_float32(preds), at_least_float32(target)
    log_preds = (preds + log_epsilon).clamp_min(SMALLEST_DEPTH).log()
    gap = torch.where(mask, log_preds - torch.where(mask, target, 1.0).log(), 0.0)
    return alpha * root(masked_mean(gap.square(), mask) - variance_focus * masked_mean(gap, mask).square())
