"""Triplanar texture: a periodic picture projected along each of three axes and blended."""

import cv2
import numpy as np
from jaxtyping import Float32

SIDE = 512
"""Side of a picture in pixels."""
CELL = 4
"""Size of its finest detail in pixels."""
ROW = 256
"""Points that are looked up as one row, because OpenCV limits an image's sides to 32767; half a picture."""

Vectors = Float32[np.ndarray, "n 3"]


class FineTexture:
    """Smooth random fields in space, for detail too fine to be stored at vertices.

    Args:
        cell: size of the detail in mm.
        channels: number of fields, at most four.
        random: source of random numbers, which determines these fields.
    """

    def __init__(self, cell: float, channels: int, random: np.random.Generator) -> None:
        self.scale = np.float32(CELL / cell)
        noise = random.standard_normal((SIDE, SIDE, channels), np.float32)
        wrapped = cv2.copyMakeBorder(noise, ROW, ROW, ROW, ROW, cv2.BORDER_WRAP)
        smooth = cv2.GaussianBlur(wrapped, (0, 0), 0.4 * CELL)[ROW:-ROW, ROW:-ROW]
        self.picture = np.ascontiguousarray(0.35 * smooth / smooth.std())

    def __call__(self, points: Vectors, shares: Vectors) -> Float32[np.ndarray, "n c"]:
        """Evaluate the fields, about in [-1, 1], at points; `shares` are the weights of the three axes."""
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
    """Compute the weights of the three axes' pictures for these normals; they add up to 1."""
    shares = np.square(np.square(normals))
    return shares / shares.sum(axis=1, keepdims=True)
