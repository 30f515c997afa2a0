"""Decode optical flow in files of C3VD's renderer."""

import numpy as np
from jaxtyping import Bool, Float32, UInt16

from col3d.data.datasets.release import (
    FULL_CODE,
)

MAX_FLOW = 20.0
"""Motion in pixels of the highest code."""


def decoded_flow(
    codes: UInt16[np.ndarray, "h w 3"],
) -> tuple[Float32[np.ndarray, "h w 2"], Bool[np.ndarray, "h w"]]:
    """Decode motion in pixels, and where it is known: where no code is 0 or the highest.

    Code 0 stands for a point that the frame before does not show; motion beyond 20 pixels is clamped to
    either end.
    """
    two = codes[..., :2]
    pixels = two.astype(np.float32) * np.float32(2 * MAX_FLOW / FULL_CODE) - np.float32(MAX_FLOW)
    return pixels, np.asarray(((two > 0) & (two < FULL_CODE)).all(axis=-1))
