"""Depth of every data set in house units, from the pixels of a file that is decoded already."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32

from col3d.data import c3vd, simcol3d
from col3d.data.folder import FolderFrames
from col3d.data.frames import FrameSet
from col3d.data.octagon import octagon_mask
from col3d.data.release import FULL_CODE
from col3d.data.simcol3d import SimCol3D


@dataclass(frozen=True)
class Depth:
    """Depth of one frame.

    Attributes:
        mm: along the optical axis; of no meaning where it is not known.
        known: where its code counts, outside the octagon too.
    """

    mm: Float32[np.ndarray, "h w"]
    known: Bool[np.ndarray, "h w"]


def depth_of(frames: FrameSet, codes: np.ndarray) -> Depth:
    """Depth as `FrameSet.depth_and_mask` has it, but for the octagon."""
    if isinstance(frames, FolderFrames):
        mm = codes.astype(np.float32) * np.float32(frames.depth_unit)
        return Depth(mm, np.isfinite(mm) & (mm > 0) & (mm <= frames.max_depth))
    if isinstance(frames, SimCol3D):
        scale = np.float32(simcol3d.MAX_DEPTH / simcol3d.FULL_CODE)
        return Depth(codes.astype(np.float32) * scale, (codes > 0) & (codes <= simcol3d.FULL_CODE))
    scale = np.float32(c3vd.MAX_DEPTH / FULL_CODE)
    return Depth(codes.astype(np.float32) * scale, (codes > 0) & (codes < FULL_CODE))


def share_outside(known: Bool[np.ndarray, "h w"]) -> float:
    """Share of the pixels with depth that lie outside the octagon."""
    height, width = known.shape
    outside = ~octagon_mask((height, width))[0].numpy()
    return float(np.count_nonzero(known & outside)) / max(1, int(np.count_nonzero(known)))
