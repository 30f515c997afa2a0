"""Encode depth and normals in the 16-bit codes of C3VD's current release, and write them as TIFF."""

from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt16

from col3d.data.datasets.release import FULL_CODE
from col3d.io.atomic import write_whole

DEFLATE = [cv2.IMWRITE_TIFF_COMPRESSION, cv2.IMWRITE_TIFF_COMPRESSION_ADOBE_DEFLATE]


def depth_codes(
    depth: Float[np.ndarray, "h w"], max_depth: float, mask: Bool[np.ndarray, "h w"] | None = None
) -> UInt16[np.ndarray, "h w"]:
    """Depth as codes of which 65535 is `max_depth`; 0 outside the mask, never 0 or 65535 inside it.

    Args:
        depth: depth in mm.
        max_depth: mm; larger depth has the highest code but one.
        mask: where depth is known; everywhere when absent.
    """
    codes = np.rint(depth * (FULL_CODE / max_depth)).clip(1, FULL_CODE - 1).astype(np.uint16)
    return codes if mask is None else codes * mask


def normal_codes(
    normals: Float[np.ndarray, "h w 3"], mask: Bool[np.ndarray, "h w"] | None = None
) -> UInt16[np.ndarray, "h w 3"]:
    """Normals as codes (n + 1) / 2 * 65535 in standard axes, as the current release; 0 outside the mask."""
    codes = np.rint((normals + 1) * (FULL_CODE / 2)).clip(0, FULL_CODE).astype(np.uint16)
    return codes if mask is None else codes * mask[..., None]


def write_tiff(path: Path, codes: UInt16[np.ndarray, "h w *c"]) -> None:
    """Write codes (h, w), or (h, w, 3) with red first, losslessly compressed.

    Raises:
        OSError: it cannot be written.
    """
    pixels = codes if codes.ndim == 2 else codes[..., ::-1]
    done, content = cv2.imencode(".tiff", pixels, DEFLATE)
    assert done
    write_whole(path, content.tobytes())
