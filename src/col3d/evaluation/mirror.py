"""Predictions averaged with those of the mirrored frames."""

from collections.abc import Callable

import torch
from jaxtyping import Float
from torch import Tensor

from col3d.batch import Batch, Prediction
from col3d.geometry import unit


def mirror_average(predict: Callable[[Batch], Prediction], batch: Batch, ramp: bool = False) -> Prediction:
    """The mean of what is predicted for a batch and, mirrored back, for its mirror image.

    Depth is averaged in mm; normals are, too, and brought back to unit length.

    Args:
        predict: batch -> prediction.
        batch: frames with their rays.
        ramp: at the left border take the mirrored prediction alone, at the right border the direct one, and
            come to the mean between 5 and 10 % of the width, as published programs do.

    References:
        Godard, Mac Aodha, Brostow: Unsupervised Monocular Depth Estimation with Left-Right Consistency, CVPR
        2017, section 3.3, whose ramp is that of the published evaluation of NeWCRFs.
    """
    mirrored: Batch = {**batch, "image": batch["image"].flip(-1), "rays": mirror_vectors(batch["rays"])}
    plain, other = predict(batch), predict(mirrored)
    share = direct_share(plain["depth"].shape[-1], ramp).to(plain["depth"])
    mean: Prediction = {"depth": share * plain["depth"] + (1 - share) * other["depth"].flip(-1)}
    if "normals" in plain:
        mean["normals"] = unit(share * plain["normals"] + (1 - share) * mirror_vectors(other["normals"]))
    return mean


def direct_share(width: int, ramp: bool) -> Float[Tensor, " w"]:
    """What share of the mean is the direct prediction's, column by column."""
    if not ramp:
        return torch.full((width,), 0.5)
    from_left = torch.linspace(0, 1, width)
    left = 1 - (20 * (from_left - 0.05)).clamp(0, 1)
    return (1 - left + left.flip(0)) / 2


def mirror_vectors(vectors: Float[Tensor, "b 3 h w"]) -> Float[Tensor, "b 3 h w"]:
    """A map of vectors as the mirrored scene has it: left and right exchanged, x with its other sign."""
    return vectors.flip(-1) * vectors.new_tensor([-1.0, 1.0, 1.0])[:, None, None]
