"""The five metrics of normals, one value a frame."""

import functools
from collections.abc import Mapping

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from col3d.batch import check_maps
from col3d.geometry import angle_between
from col3d.metrics.functional.by_frame import by_frame
from col3d.registry.metric_specs import PAPER_NORMALS

NORMAL_METRICS = tuple(spec.name for spec in PAPER_NORMALS)
LIMITS = {"within_11_25": 11.25, "within_22_5": 22.5, "within_30": 30.0}
FURTHER_LIMITS = {"within_5": 5.0, "within_7_5": 7.5}


def normal_metrics(
    preds: Float[Tensor, "b 3 h w"],
    target: Float[Tensor, "b 3 h w"],
    mask: Bool[Tensor, "b 1 h w"],
    cosine_epsilon: float = 0.0,
) -> dict[str, Float[Tensor, " b"]]:
    """Angles between normals, one value a frame: mean and median in degrees, shares below three limits.

    Args:
        preds: predicted normals of any length.
        target: true normals.
        mask: True where a pixel counts.
        cosine_epsilon: 0 measures angles exactly. Published code adds 1e-3 to |p| |t| in the denominator of
            the cosine, so that a perfect prediction scores 2.56 degrees; give that to reproduce its figures.

    Returns:
        Values by name, shape (b,), float64; NaN for a frame of which no pixel counts, and errors of NaN where
        a predicted normal is NaN or zero.

    Raises:
        ValueError: the shapes do not belong together.
    """
    check_maps(preds, target, mask)
    return by_frame(functools.partial(_errors, cosine_epsilon, False), preds, target, mask)


def normal_errors(
    preds: Float[Tensor, "b 3 h w"],
    target: Float[Tensor, "b 3 h w"],
    mask: Bool[Tensor, "b 1 h w"],
    cosine_epsilon: float = 0.0,
) -> dict[str, Float[Tensor, " b"]]:
    """The values of `normal_metrics`, with `angle_rmse` in degrees and the shares below 5 and 7.5 degrees."""
    check_maps(preds, target, mask)
    return by_frame(functools.partial(_errors, cosine_epsilon, True), preds, target, mask)


def _errors(
    cosine_epsilon: float, further: bool, preds: Tensor, target: Tensor, mask: Tensor
) -> dict[str, Tensor]:
    angles = _angles(preds.float(), target.float(), cosine_epsilon)
    count = mask.sum(dim=(1, 2, 3), dtype=torch.float64)

    def mean(values: Tensor) -> Tensor:
        return torch.where(mask, values, 0.0).sum(dim=(1, 2, 3), dtype=torch.float64) / count

    def shares(limits: Mapping[str, float]) -> dict[str, Tensor]:
        return {name: (mask & (angles < limit)).sum(dim=(1, 2, 3)) / count for name, limit in limits.items()}

    errors = {"angle_mean": mean(angles), "angle_median": _median(angles, mask), **shares(LIMITS)}
    if further:
        errors |= {"angle_rmse": mean(angles.double().square()).sqrt(), **shares(FURTHER_LIMITS)}
    return errors


def _median(values: Tensor, mask: Tensor) -> Tensor:
    """Middle value of each frame, the mean of the two middle ones of an even number; NaN for none."""
    medians = values.new_full((len(values),), torch.nan, dtype=torch.float64)
    for i, (frame_values, counts) in enumerate(zip(values, mask, strict=True)):
        if len(counting := frame_values[counts]):
            lower = counting.median()
            above = counting > lower
            upper = torch.where(above, counting, torch.inf).min()
            medians_differ = 2 * above.sum() >= len(counting)  # never for an odd count, or where it is NaN
            upper = torch.where(medians_differ, upper, lower)
            medians[i] = (lower.double() + upper.double()) / 2
    return medians


def _angles(preds: Tensor, target: Tensor, cosine_epsilon: float) -> Tensor:
    if cosine_epsilon == 0:
        undefined = (preds == 0).all(dim=1, keepdim=True)
        return torch.where(undefined, torch.nan, angle_between(preds, target))
    lengths = preds.norm(dim=1, keepdim=True) * target.norm(dim=1, keepdim=True)
    cosine = (preds * target).sum(dim=1, keepdim=True) / (lengths + cosine_epsilon)
    return torch.rad2deg(torch.acos(cosine.clamp(-1, 1)))
