"""Alignment of predicted depth to the truth: a factor, or a factor and an offset, by frame or by video."""

from collections.abc import Callable, Sequence

import numpy as np
import torch
from jaxtyping import Float64
from torch import Tensor

Values = Float64[Tensor, " n"]
Frames = Sequence[tuple[Values, Values]]
"""Prediction and truth of the pixels of each frame that count; at least one frame, none of them empty."""
Aligned = Callable[[Tensor], Tensor]
"""Predictions -> the same, aligned."""
QUANTILES = 2**24
"""Number of values up to which torch computes quantiles."""


def unaligned(frames: Frames) -> Aligned:
    """Leave predictions as they are."""
    return lambda values: values


def by_medians(frames: Frames) -> Aligned:
    """A factor: the ratio of the medians."""
    guess, truth = _joined(frames)
    factor = _median(truth) / _median(guess)
    return lambda values: values * factor


def by_least_squares(frames: Frames) -> Aligned:
    """A factor s that minimises sum (s p - t)^2."""
    guess, truth = _joined(frames)
    factor = (guess * truth).sum() / guess.square().sum()
    return lambda values: values * factor


def by_least_absolute(frames: Frames) -> Aligned:
    """A factor s that minimises sum |s p - t| / t: the median of t / p weighted by p / t.

    References:
        Wang et al.: MoGe: Unlocking Accurate Monocular Geometry Estimation for Open-Domain Images with
        Optimal Training Supervision, CVPR 2025, section 3.2 (errors weighted by the inverse depth).
    """
    guess, truth = _joined(frames)
    ratios, order = (truth / guess).sort()
    weights = (guess / truth)[order].cumsum(dim=0)
    factor = ratios[torch.searchsorted(weights, weights[-1] / 2)]
    return lambda values: values * factor


def by_scale_and_shift(frames: Frames) -> Aligned:
    """A factor s and an offset o that minimise sum (s p + o - t)^2; as it is where one pixel counts."""
    guess, truth = _joined(frames)
    if len(guess) < 2:
        return lambda values: values
    spread = guess.var(correction=0)
    slope = ((guess - guess.mean()) * (truth - truth.mean())).mean() / spread if spread > 0 else spread
    return lambda values: slope * (values - guess.mean()) + truth.mean()


def by_means(frames: Frames) -> Aligned:
    """A factor of the mean depths of frames f: sum_f mean(p_f) mean(t_f) / sum_f mean(p_f)^2.

    References:
        Rau et al.: SimCol3D: 3D reconstruction during colonoscopy challenge, Medical Image Analysis 96,
        2024, section 3.4.1.
    """
    means = [(guess.mean(), truth.mean()) for guess, truth in frames]
    factor = sum(guess * truth for guess, truth in means) / sum(guess.square() for guess, _ in means)
    return lambda values: values * factor


def by_median_residual(frames: Frames) -> Aligned:
    """A factor s from which `scipy.optimize.leastsq`, begun at 1, improves median((t - s p)^2) no more.

    The median is flat in places, where the solver stops: the factor need not be the best one.

    References:
        Paruchuri et al.: Leveraging Near-Field Lighting for Monocular Depth Estimation from Endoscopy
        Videos (PPSNet), ECCV 2024; its evaluation program.
    """
    from scipy.optimize import leastsq

    guess, truth = (values.cpu().numpy() for values in _joined(frames))
    factor = float(leastsq(lambda scale: np.median((truth - scale * guess) ** 2), 1.0)[0][0])
    return lambda values: values * factor


FITS: dict[str, Callable[[Frames], Aligned]] = {
    "none": unaligned,
    "median": by_medians,
    "least_squares": by_least_squares,
    "least_absolute": by_least_absolute,
    "scale_and_shift": by_scale_and_shift,
    "means": by_means,
    "median_residual": by_median_residual,
}
IN_WORDS = {
    "none": "none",
    "median": "a factor{of}, of the medians",
    "least_squares": "a factor{of}, by least squares",
    "least_absolute": "a factor{of}, by least absolute relative errors",
    "scale_and_shift": "a factor and an offset{of}, by least squares",
    "means": "a factor{of}, of the frames' means",
    "median_residual": "a factor{of}, by the median of squared residuals",
}
"""For the captions of tables; {of} is where it says of inverse depth."""
DOMAINS = ("depth", "inverse_depth")


def alignment(fit: str, domain: str, frames: Frames) -> Aligned:
    """The alignment of predicted depth in mm that a fit to these frames gives.

    Fitted to inverse depth, predictions are aligned there, and may become no deeper than the deepest truth.

    Args:
        fit: a key of `FITS`.
        domain: "depth" or "inverse_depth".
        frames: frames to fit to.
    """
    if domain == "depth" or fit == "none":
        return FITS[fit](frames)
    aligned = FITS[fit]([(guess.reciprocal(), truth.reciprocal()) for guess, truth in frames])
    deepest = max(truth.max() for _, truth in frames)
    return lambda values: aligned(values.reciprocal()).clamp_min(1 / deepest).reciprocal()


def _joined(frames: Frames) -> tuple[Values, Values]:
    guesses, truths = zip(*frames, strict=True)
    return torch.cat(guesses), torch.cat(truths)


def _median(values: Values) -> Tensor:
    if len(values) <= QUANTILES:
        return values.quantile(0.5)
    return torch.tensor(np.median(values.cpu().numpy()), device=values.device)
