"""Temporal flicker: unsteadiness of depth from frame to frame, without ground truth."""

import torch
from jaxtyping import Bool, Float
from torch import Tensor


def temporal_flicker(
    before: Float[Tensor, "b 1 h w"],
    now: Float[Tensor, "b 1 h w"],
    after: Float[Tensor, "b 1 h w"],
    mask: Bool[Tensor, "b 1 h w"] | None = None,
) -> Float[Tensor, " b"]:
    """Percent by which depth deviates from the geometric mean of its two neighbours in time.

    100 times the median over pixels of |log d_t - (log d_{t-1} + log d_{t+1}) / 2|: zero for a camera that
    stands still, and for a depth that grows or shrinks everywhere by a steady factor. True depth of a moving
    camera flickers a little too, at the edges of folds; compare with that where it is known.

    Args:
        before: depth of the previous frames, above 0, in any unit.
        now: depth of the frames themselves.
        after: depth of the next frames.
        mask: pixels that count; all when absent.

    Returns:
        One value a frame; NaN where no pixel counts.
    """
    change = (now.log() - (before.log() + after.log()) / 2).abs() * 100
    if mask is not None:
        change = change.masked_fill(~mask, torch.nan)
    return change.flatten(1).nanquantile(0.5, dim=1)
