"""The octagonal field of view of C3VD's endoscope."""

from functools import lru_cache

import torch
from jaxtyping import Bool
from torch import Tensor

SIZE_HW = (1080, 1350)
MIDDLE_UV = (674.8, 539.9)
SLOPE = 0.8045
REACH = 906.35


@lru_cache(maxsize=8)
def octagon_mask(size_hw: tuple[int, int] = SIZE_HW) -> Bool[Tensor, "1 h w"]:
    """True inside the octagon that all of C3VD's frames have, at this size; cached, so do not write to it.

    Four straight cuts at the corners, |u - 674.8| + 0.8045 |v - 539.9| <= 906.35 in pixels of the
    1350 x 1080 frame, fitted to the frames of the data set.
    """
    height, width = size_hw
    v = ((torch.arange(height) + 0.5) * (SIZE_HW[0] / height) - 0.5)[:, None]
    u = ((torch.arange(width) + 0.5) * (SIZE_HW[1] / width) - 0.5)[None, :]
    return ((u - MIDDLE_UV[0]).abs() + SLOPE * (v - MIDDLE_UV[1]).abs() <= REACH)[None]
