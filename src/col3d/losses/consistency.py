"""Cross-task consistency (X-TC): predicted normals compared with the normals of the predicted depth."""

from jaxtyping import Bool, Float
from torch import Tensor

from col3d.losses.normals import normal_l1, normal_rmse


def cross_task_rmse(
    preds: Float[Tensor, "b 3 h w"], target: Float[Tensor, "b 3 h w"], mask: Bool[Tensor, "b 1 h w"]
) -> Float[Tensor, ""]:
    """Root mean squared error between predicted normals and those derived from the predicted depth.

    Args:
        preds: predicted unit normals.
        target: `normals_from_depth` of the predicted depth, gradient included; zero where undefined.
        mask: True where a pixel counts; pixels without a derived normal are left out, too.

    Returns:
        A scalar; zero where nothing counts.

    References:
        Chavarrias Solano et al.: Multi-task learning with cross-task consistency for improved depth
        estimation in colonoscopy, Medical Image Analysis 2025, L_x-tc.
    """
    return normal_rmse(preds, target, mask & _derived(target))


def cross_task_l1(
    preds: Float[Tensor, "b 3 h w"], target: Float[Tensor, "b 3 h w"], mask: Bool[Tensor, "b 1 h w"]
) -> Float[Tensor, ""]:
    """Mean absolute error between predicted normals and those derived from the predicted depth."""
    return normal_l1(preds, target, mask & _derived(target))


def _derived(normals: Tensor) -> Tensor:
    return (normals.detach() != 0).any(dim=1, keepdim=True)
