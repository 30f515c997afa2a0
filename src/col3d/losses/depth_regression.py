"""Pixel-wise errors of depth: in mm, and of its logarithm."""

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from col3d.batch import check_maps
from col3d.geometry.precision import at_least_float32
from col3d.losses.depth import silog
from col3d.losses.masked import masked_mean


def depth_l1(
    preds: Float[Tensor, "b 1 h w"], target: Float[Tensor, "b 1 h w"], mask: Bool[Tensor, "b 1 h w"]
) -> Float[Tensor, ""]:
    """Mean absolute error in mm.

    The published pix2pix computes it for depth in [-1, 1], where it is 2 / max_depth times this one.

    Args:
        preds: predicted depth in mm.
        target: true depth in mm; anything where masked.
        mask: True where a pixel counts; the mean is over all of the batch's counting pixels.

    Returns:
        A scalar; zero where nothing counts.

    Raises:
        ValueError: the shapes do not belong together.

    References:
        Isola et al.: Image-to-Image Translation with Conditional Adversarial Networks, CVPR 2017, eq. 3.
    """
    check_maps(preds, target, mask)
    gap = torch.where(mask, at_least_float32(preds) - at_least_float32(target), 0.0)
    return masked_mean(gap.abs(), mask)


def rmse_log(
    preds: Float[Tensor, "b 1 h w"], target: Float[Tensor, "b 1 h w"], mask: Bool[Tensor, "b 1 h w"]
) -> Float[Tensor, ""]:
    """Root mean squared difference of natural logarithms: SILog without any invariance to scale.

    Args:
        preds: predicted depth in mm.
        target: true depth in mm; anything where masked.
        mask: True where a pixel counts; the mean is over all of the batch's counting pixels.

    Returns:
        A scalar; zero where nothing counts.

    Raises:
        ValueError: the shapes do not belong together.

    References:
        Eigen, Puhrsch, Fergus: Depth Map Prediction from a Single Image using a Multi-Scale Deep Network,
        NeurIPS 2014, section 4.3; the depth loss of the public MonoDepth-FPN.
    """
    return silog(preds, target, mask, alpha=1.0, variance_focus=0.0)
