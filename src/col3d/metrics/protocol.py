"""Evaluation protocols: scaling, masking and axes applied before the metrics are computed."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn.functional import interpolate

from col3d.batch import Batch, Prediction, normals_mask
from col3d.errors import check_known
from col3d.geometry import unit
from col3d.metrics.measure import NONE, SMALLEST, Options, measure

Depth = Float[Tensor, "b 1 h w"]
Mask = Bool[Tensor, "b 1 h w"]


@dataclass(frozen=True)
class Protocol:
    """How predictions are scored; the defaults are the standard one's."""

    name: str = "standard"
    scaling: str = "none"
    """How predictions are fitted to the truth of each frame: "none", "median" (one factor, of the medians) or
    "scale_and_shift" (least squares)."""
    truth_range: tuple[float, float] = (0.0, float("inf"))
    """True depths in mm that count, both ends excluded."""
    cosine_epsilon: float = 0.0
    """Term added to |p| |t| in the denominator of the cosine of normals; published code has 1e-3."""
    normal_axes: str = "standard"
    """"standard", or "published": y up, z out of the screen, and a true z below 0 clipped to 0."""
    metrics: Options | None = None
    """Options of metrics, by their names."""

    def __post_init__(self) -> None:
        check_known("protocol.scaling", self.scaling, SCALINGS)
        check_known("protocol.normal_axes", self.normal_axes, ("standard", "published"))

    def score(
        self, prediction: Prediction, batch: Batch, validation: bool = False
    ) -> dict[str, Float[Tensor, " b"]]:
        """All registered metrics of each frame by name, with the numbers of `pixels` and `normal_pixels`.

        A prediction of another size than the truth is resized to it bilinearly.

        Args:
            prediction: depth in mm, and normals where there are any.
            batch: frames with their truth.
            validation: whether to leave out metrics that validation does not measure, which take longer.
        """
        low, high = self.truth_range
        depth = batch["depth"]
        mask = batch["mask"] & (depth > low) & (depth < high)
        guess = SCALINGS[self.scaling](_resized(prediction["depth"], depth), depth, mask)
        given: dict[str, Any] = {"options": self.metrics or NONE, "validation": validation}
        values = measure("depth", guess, depth, mask, max_depth=max(high, SMALLEST), **given)
        if "normals" in prediction and "normals" in batch:
            pair = (_resized(prediction["normals"], depth), batch["normals"])
            if self.normal_axes == "published":
                pair = published_axes(unit(pair[0])), cut_behind(published_axes(pair[1]))
            counted = mask & normals_mask(batch)
            values |= measure("normals", *pair, counted, cosine_epsilon=self.cosine_epsilon, **given)
            values["normal_pixels"] = counted.sum(dim=(1, 2, 3))
        return values | {"pixels": mask.sum(dim=(1, 2, 3))}


def by_median(preds: Depth, target: Depth, mask: Mask) -> Depth:
    """Each frame's prediction times the ratio of the medians over counting pixels."""
    scaled = preds.double()
    for i, counts in enumerate(mask):
        if counts.any():
            factor = target[i][counts].double().quantile(0.5) / scaled[i][counts].quantile(0.5)
            scaled[i] = scaled[i] * factor
    return scaled.to(preds.dtype)


def by_scale_and_shift(preds: Depth, target: Depth, mask: Mask) -> Depth:
    """Each frame's s * prediction + t, with s and t that minimise the squared error over counting pixels."""
    fitted = preds.double()
    for i, counts in enumerate(mask):
        if counts.sum() > 1:
            guess, truth = fitted[i][counts], target[i][counts].double()
            spread = guess.var(correction=0)
            slope = (
                ((guess - guess.mean()) * (truth - truth.mean())).mean() / spread if spread > 0 else spread
            )
            fitted[i] = slope * (fitted[i] - guess.mean()) + truth.mean()
    return fitted.to(preds.dtype)


SCALINGS: dict[str, Callable[[Tensor, Tensor, Tensor], Tensor]] = {
    "none": lambda preds, target, mask: preds,
    "median": by_median,
    "scale_and_shift": by_scale_and_shift,
}


def published_axes(normals: Float[Tensor, "b 3 h w"]) -> Float[Tensor, "b 3 h w"]:
    """Convert normals from standard axes to y up and z out of the screen."""
    return normals * normals.new_tensor([1.0, -1.0, -1.0])[:, None, None]


def cut_behind(normals: Float[Tensor, "b 3 h w"]) -> Float[Tensor, "b 3 h w"]:
    """Clip z below 0 to 0 in published axes, as C3VD stored normals before May 2023."""
    return torch.cat([normals[:, :2], normals[:, 2:].clamp_min(0)], dim=1)


def _resized(values: Tensor, like: Tensor) -> Tensor:
    if values.shape[-2:] == like.shape[-2:]:
        return values
    return interpolate(values, like.shape[-2:], mode="bilinear", align_corners=False)
