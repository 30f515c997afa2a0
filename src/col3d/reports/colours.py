"""Colours shared by all pictures: grey for unknown pixels, and the colours of normals."""

import numpy as np

GREY = 0.8
"""Brightness of pixels without a value."""
NORMAL_AXES = np.array([1.0, -1.0, -1.0])
"""X to red, -y to green, -z to blue: a wall that faces the camera is blue."""


def colours_of_normals(normals: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Normals (h, w, 3) by `NORMAL_AXES`, each from [-1, 1] to [0, 1]; grey where nothing counts."""
    colours = (normals * NORMAL_AXES + 1) / 2
    return np.where(mask[..., None], colours.clip(0, 1), GREY)
