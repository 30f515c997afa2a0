"""Test-time augmentation: predictions averaged with those of the mirrored frames."""

from collections.abc import Callable

import torch
from jaxtyping import Float
from torch import Tensor

from col3d.batch import Batch, Prediction
from col3d.geometry import unit


def mirror_average(predict: Callable[[Batch], Prediction], batch: Batch, way: str = "mean") -> Prediction:
    """Average the prediction for a batch and, mirrored back, that for its mirror image.

    Depth is averaged in mm; normals are averaged and normalised to unit length.

    Args:
        predict: batch -> prediction.
        batch: frames with their rays.
        way: of averaging, a key of `SHARES`.

    References:
        Godard, Mac Aodha, Brostow: Unsupervised Monocular Depth Estimation with Left-Right Consistency, CVPR
        2017, section 3.3, whose ramp is that of the published evaluation of NeWCRFs.
    """
    mirrored: Batch = {**batch, "image": batch["image"].flip(-1), "rays": mirror_vectors(batch["rays"])}
    plain, other = predict(batch), predict(mirrored)
    share = SHARES[way](plain["depth"].shape[-1]).to(plain["depth"])
    mean: Prediction = {"depth": share * plain["depth"] + (1 - share) * other["depth"].flip(-1)}
    if "normals" in plain:
        mean["normals"] = unit(share * plain["normals"] + (1 - share) * mirror_vectors(other["normals"]))
    return mean


def even_share(width: int) -> Float[Tensor, " w"]:
    """Weight of the direct prediction in each column: a half."""
    return torch.full((width,), 0.5)


def ramp_share(width: int) -> Float[Tensor, " w"]:
    """Weight of the direct prediction in each column, as published programs have it.

    The mirrored prediction alone counts at the left border, the direct one at the right border; between 5 and
    10 % of the width the weights change to a half.
    """
    from_left = torch.linspace(0, 1, width)
    left = 1 - (20 * (from_left - 0.05)).clamp(0, 1)
    return (1 - left + left.flip(0)) / 2


SHARES: dict[str, Callable[[int], Tensor]] = {"mean": even_share, "ramp": ramp_share}
"""Ways of averaging: width -> weight of the direct prediction in each column."""


def mirror_vectors(vectors: Float[Tensor, "b 3 h w"]) -> Float[Tensor, "b 3 h w"]:
    """Mirror a map of vectors: exchange left and right, and negate x."""
    return vectors.flip(-1) * vectors.new_tensor([-1.0, 1.0, 1.0])[:, None, None]
