"""Boundary F1: how well edges of predicted depth, such as rims of folds, match those of true depth."""

import functools
from collections.abc import Iterator
from typing import Annotated

import torch
from jaxtyping import Bool, Float
from pydantic import Field
from torch import Tensor
from torch.nn.functional import max_pool2d

from col3d.batch import check_maps
from col3d.metrics.functional.by_frame import by_frame


def boundary_f1(
    preds: Float[Tensor, "b 1 h w"],
    target: Float[Tensor, "b 1 h w"],
    mask: Bool[Tensor, "b 1 h w"],
    min_threshold: Annotated[float, Field(gt=1)] = 1.05,
    max_threshold: Annotated[float, Field(gt=1)] = 1.25,
    thresholds: Annotated[int, Field(ge=1, le=1000)] = 10,
    erosion: Annotated[int, Field(ge=0, le=100)] = 0,
) -> Float[Tensor, " b"]:
    """F1 score of the edges of depth, without any alignment: scale does not matter, nor does inverting both.

    For each threshold t, equally spaced, a pixel has an edge to its left, right, upper or lower neighbour
    where its depth is more than t times the neighbour's. Recall is the mean over the four directions of
    |both| / max(|true|, 1), precision that of |both| / max(|predicted|, 1), F1 = 2 p r / (p + r) or 0, and
    the score is the mean of F1 weighted by t. A frame without true edges scores 0.

    Differs from the authors' code where pixels do not count: pairs that hold one are left out.

    Args:
        preds: predicted depth, above 0, in any unit.
        target: true depth; anything where masked.
        mask: True where a pixel counts.
        min_threshold: the least ratio of an edge.
        max_threshold: the greatest ratio of an edge.
        thresholds: number of thresholds.
        erosion: pixels by which the mask is eroded: 2 is the square of 5 x 5 of EndoStreamDepth.

    Returns:
        Values between 0 and 1, shape (b,), float64; NaN for a frame of which no pixel counts.

    Raises:
        ValueError: the shapes do not belong together.

    References:
        Bochkovskii et al.: Depth Pro: Sharp Monocular Metric Depth in Less Than a Second, ICLR 2025,
        section 3.4.
    """
    check_maps(preds, target, mask)
    steps = sorted(torch.linspace(min_threshold, max_threshold, thresholds, dtype=torch.float64).tolist())
    score = functools.partial(_scores, steps, erosion)
    return by_frame(score, preds, target, mask)["boundary_f1"]


def _scores(
    steps: list[float], erosion: int, preds: Tensor, target: Tensor, mask: Tensor
) -> dict[str, Tensor]:
    counts = _eroded(mask, erosion)
    limits = torch.tensor(steps, dtype=torch.float64, device=preds.device)
    shares = [_shares(guess, truth, limits) for guess, truth in _ratios(preds, target, counts)]
    recall, precision = (torch.stack(directions).mean(dim=0) for directions in zip(*shares, strict=True))
    both = recall + precision
    f1 = torch.where(both > 0, 2 * recall * precision / both, 0.0)
    score = (limits * f1).sum(dim=1) / limits.sum()
    return {"boundary_f1": torch.where(counts.flatten(1).any(dim=1), score, torch.nan)}


def _eroded(mask: Tensor, erosion: int) -> Tensor:
    if erosion == 0:
        return mask
    return max_pool2d((~mask).float(), 2 * erosion + 1, stride=1, padding=erosion) == 0


def _ratios(preds: Tensor, target: Tensor, mask: Tensor) -> Iterator[tuple[Tensor, Tensor]]:
    """For each direction, predicted and true depth over the neighbour's; 0 where a pair does not count."""
    guess = torch.where(mask, preds, 1.0).double()
    truth = torch.where(mask, target, 1.0).double()
    for dim in (-1, -2):
        length = mask.shape[dim] - 1
        (p, p_next), (t, t_next), (m, m_next) = (
            (values.narrow(dim, 0, length), values.narrow(dim, 1, length)) for values in (guess, truth, mask)
        )
        counts = (m & m_next).double()
        yield p / p_next * counts, t / t_next * counts
        yield p_next / p * counts, t_next / t * counts


def _shares(guess: Tensor, truth: Tensor, limits: Tensor) -> tuple[Tensor, Tensor]:
    """Recall and precision of the edges of one direction, (b, number of thresholds)."""
    hits, predicted, true = (_above(r, limits) for r in (torch.minimum(guess, truth), guess, truth))
    return hits / true.clamp_min(1), hits / predicted.clamp_min(1)


def _above(ratios: Tensor, limits: Tensor) -> Tensor:
    """Number of ratios of each frame above each limit: few exceed the least, and only those are sorted."""
    frame, *_ = places = (ratios > limits[0]).nonzero(as_tuple=True)
    levels = torch.bucketize(ratios[places], limits)  # the number of limits below
    size = len(limits) + 1
    counts = torch.bincount(frame * size + levels, minlength=len(ratios) * size).view(-1, size)
    return counts.flip(1).cumsum(dim=1).flip(1)[:, 1:].double()
