"""Fine texture of a wall without a map of it: a periodic picture seen along each of three axes, blended."""

import cv2
import numpy as np
from jaxtyping import Float32

SIDE = 512
"""Pixels of a picture."""
CELL = 4
"""Pixels of its finest detail."""
ROW = 256
"""Points looked up as one row of an image, for OpenCV takes none longer than 32767; and half a picture."""

Vectors = Float32[np.ndarray, "n 3"]


class FineTexture:
    """Smooth random fields in space, for detail too fine to be kept at vertices.

    Args:
        cell: size of the detail in mm.
        channels: number of fields, at most four.
        random: what makes these fields differ from others.
    """

    def __init__(self, cell: float, channels: int, random: np.random.Generator) -> None:
        self.scale = np.float32(CELL / cell)
        noise = random.standard_normal((SIDE, SIDE, channels), np.float32)
        wrapped = cv2.copyMakeBorder(noise, ROW, ROW, ROW, ROW, cv2.BORDER_WRAP)
        smooth = cv2.GaussianBlur(wrapped, (0, 0), 0.4 * CELL)[ROW:-ROW, ROW:-ROW]
        self.picture = np.ascontiguousarray(0.35 * smooth / smooth.std())

    def __call__(self, points: Vectors, shares: Vectors) -> Float32[np.ndarray, "n c"]:
        """The fields, about in [-1, 1], at points whose normals have these shares of the three axes."""
        count = len(points)
        places = np.zeros((3, -(-count // ROW) * ROW), np.float32)
        places[:, :count] = points.T * self.scale
        rows = places.reshape(3, -1, ROW)
        total = np.zeros((count, self.picture.shape[2]), np.float32)
        for axis in range(3):
            u, v = rows[axis - 2], rows[axis - 1]
            seen = cv2.remap(self.picture, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
            total += shares[:, axis, None] * seen.reshape(len(places[0]), -1)[:count]
        return total


def axis_shares(normals: Vectors) -> Vectors:
    """How much the picture along each axis counts where the wall faces these ways; they add up to 1."""
    shares = np.square(np.square(normals))
    return shares / shares.sum(axis=1, keepdims=True)
