"""Component-wise errors of normals."""

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from col3d.batch import check_maps
from col3d.geometry.precision import at_least_float32
from col3d.losses.masked import masked_mean, root


def normal_l1(
    preds: Float[Tensor, "b 3 h w"], target: Float[Tensor, "b 3 h w"], mask: Bool[Tensor, "b 1 h w"]
) -> Float[Tensor, ""]:
    """Mean absolute error over the components of the pixels that count; zero where none does."""
    return masked_mean(_gap(preds, target, mask).abs(), mask)


def normal_rmse(
    preds: Float[Tensor, "b 3 h w"], target: Float[Tensor, "b 3 h w"], mask: Bool[Tensor, "b 1 h w"]
) -> Float[Tensor, ""]:
    """Root mean squared error over the components of the pixels that count; zero where none does."""
    return root(masked_mean(_gap(preds, target, mask).square(), mask))


def _gap(preds: Tensor, target: Tensor, mask: Tensor) -> Tensor:
    check_maps(preds, target, mask)
    preds, target = at_least_float32(preds), at_least_float32(target)
    return torch.where(mask, preds - target, 0.0)
