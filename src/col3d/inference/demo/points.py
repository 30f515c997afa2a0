"""Point clouds of answers, as files for the page's viewer."""

from pathlib import Path

import cv2
import numpy as np
import torch
from jaxtyping import Bool

from col3d.geometry import points_from_depth
from col3d.inference.demo.answer import Answer
from col3d.reports.clouds import write_cloud

MOST_POINTS = 200_000
RIM = 0.015
"""Share of the width by which the octagon's rim is left out, where predictions are unreliable."""
VIEWERS = np.array([1.0, -1.0, -1.0], np.float32)
"""Signs that convert camera axes (y down, looking along z) to a viewer's (y up, looking along -z)."""


def write_points(answer: Answer, path: Path) -> None:
    """Write points in mm with the image's colours, upright in viewers, as PLY.

    Args:
        answer: answer with a camera.
        path: path of the file.
    """
    assert answer.camera is not None
    depth = torch.from_numpy(answer.depth)[None, None]
    points = points_from_depth(depth, answer.camera.rays())[0].permute(1, 2, 0).numpy()
    step = max(1, int(np.ceil(np.sqrt(answer.mask.sum() / MOST_POINTS))))
    thinned = (slice(None, None, step), slice(None, None, step))
    mask = _without_rim(answer.mask)[thinned]
    write_cloud(path, points[thinned][mask] * VIEWERS, answer.image[thinned][mask])


def _without_rim(mask: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    side = 2 * round(RIM * mask.shape[1]) + 1
    inside: np.ndarray = cv2.erode(mask.view(np.uint8), np.ones((side, side), np.uint8)) > 0
    return inside
