"""Evaluation protocols: scaling, masking and axes applied before the metrics are computed."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn.functional import interpolate

from col3d.batch import Batch, Prediction, normals_mask
from col3d.geometry import unit
from col3d.metrics.alignment import DOMAINS, FITS, Aligned, alignment
from col3d.metrics.measure import NONE, SMALLEST, Options, measure
from col3d.nearest_names import check_known

Depth = Float[Tensor, "b 1 h w"]
Mask = Bool[Tensor, "b 1 h w"]
POSITIVE = 1e-8
"""Depth in mm that a prediction has to exceed to count as positive."""


@dataclass(frozen=True)
class Protocol:
    """How predictions are scored; the defaults are the standard one's."""

    name: str = "standard"
    scaling: str = "none"
    """Fit of predictions to the truth, a key of `FITS`."""
    scaling_of: str = "depth"
    """What is fitted: "depth" or "inverse_depth"."""
    scaling_over: str = "frame"
    """What a fit is made for: each "frame", or the frames of a "video" together."""
    truth_range: tuple[float, float] = (0.0, float("inf"))
    """True depths in mm that count, both ends excluded."""
    cosine_epsilon: float = 0.0
    """Term added to |p| |t| in the denominator of the cosine of normals; published code has 1e-3."""
    normal_axes: str = "standard"
    """"standard", or "published": y up, z out of the screen, and a true z below 0 clipped to 0."""
    clip: tuple[float, float] | None = None
    """Bounds in mm that predictions are clipped to before anything else."""
    positive: bool = False
    """Whether pixels count only where the prediction is above 1e-8 mm."""
    epsilon: float = 0.0
    """Depth in mm added in denominators and logarithms; published programs have 1e-8 and more."""
    names: tuple[str, ...] | None = None
    """The metrics that are computed; all but those that have to be named when None."""
    metrics: Options | None = None
    """Options of metrics, by their names."""

    def __post_init__(self) -> None:
        check_known("protocol.scaling", self.scaling, FITS)
        check_known("protocol.scaling_of", self.scaling_of, DOMAINS)
        check_known("protocol.scaling_over", self.scaling_over, ("frame", "video"))
        check_known("protocol.normal_axes", self.normal_axes, ("standard", "published"))

    @property
    def aligns_videos(self) -> bool:
        """Whether the predictions of a video are aligned together."""
        return self.scaling_over == "video" and self.scaling != "none"

    def score(
        self,
        prediction: Prediction,
        batch: Batch,
        validation: bool = False,
        aligned: Aligned | None = None,
    ) -> dict[str, Float[Tensor, " b"]]:
        """All registered metrics of each frame by name, with the numbers of `pixels` and `normal_pixels`.

        A prediction of another size than the truth is resized to it bilinearly.

        Args:
            prediction: depth in mm, and normals where there are any.
            batch: frames with their truth.
            validation: whether to leave out metrics that validation does not measure, which take longer.
            aligned: alignment of all frames, as `of_video` makes it; each frame has its own when absent.
        """
        guess, depth, mask = self._compared(prediction, batch)
        if aligned is not None:
            guess = aligned(guess.double()).to(guess.dtype)
        elif self.scaling != "none":
            guess = torch.cat([self._by_frame(*maps) for maps in zip(guess, depth, mask, strict=True)])
        given: dict[str, Any] = {"options": self.metrics or NONE, "validation": validation}
        given["names"] = self.names
        high = max(self.truth_range[1], SMALLEST)
        values = measure("depth", guess, depth, mask, max_depth=high, epsilon=self.epsilon, **given)
        if "normals" in prediction and "normals" in batch:
            pair = (_resized(prediction["normals"], depth), batch["normals"])
            if self.normal_axes == "published":
                pair = published_axes(unit(pair[0])), cut_behind(published_axes(pair[1]))
            counted = mask & normals_mask(batch)
            values |= measure("normals", *pair, counted, cosine_epsilon=self.cosine_epsilon, **given)
            values["normal_pixels"] = counted.sum(dim=(1, 2, 3))
        return values | {"pixels": mask.sum(dim=(1, 2, 3))}

    def of_video(self, frames: Iterable[tuple[Prediction, Batch]]) -> Aligned:
        """The alignment of the frames of a video, fitted to all of them together."""
        pairs = []
        for prediction, batch in frames:
            for guess, depth, mask in zip(*self._compared(prediction, batch), strict=True):
                if mask.any():
                    pairs.append((guess[mask].double(), depth[mask].double()))
        return alignment(self.scaling, self.scaling_of, pairs) if pairs else lambda values: values

    def _compared(self, prediction: Prediction, batch: Batch) -> tuple[Depth, Depth, Mask]:
        """Predicted depth at the size of the truth, clipped; the truth, and which pixels count."""
        low, high = self.truth_range
        depth = batch["depth"]
        mask = batch["mask"] & (depth > low) & (depth < high)
        guess = _resized(prediction["depth"], depth)
        if self.clip is not None:
            guess = guess.clamp(*self.clip)
        return guess, depth, mask & (guess > POSITIVE) if self.positive else mask

    def _by_frame(self, guess: Tensor, depth: Tensor, mask: Tensor) -> Tensor:
        """A frame (1, h, w) aligned by itself, as a batch of one."""
        if not mask.any():
            return guess[None]
        pair = guess[mask].double(), depth[mask].double()
        return alignment(self.scaling, self.scaling_of, [pair])(guess.double()).to(guess.dtype)[None]


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
