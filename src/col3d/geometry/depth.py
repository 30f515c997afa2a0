"""Convert depth to points."""

from jaxtyping import Float
from torch import Tensor


def points_from_depth(
    depth: Float[Tensor, "b 1 h w"], rays: Float[Tensor, "*b 3 h w"]
) -> Float[Tensor, "b 3 h w"]:
    """Points in camera axes, in mm: ray / ray_z * depth.

    Args:
        depth: depth along the optical axis, in mm.
        rays: unit rays, one map for all frames or one for each.

    Returns:
        Points in mm.
    """
    return rays / rays.narrow(-3, 2, 1) * depth
