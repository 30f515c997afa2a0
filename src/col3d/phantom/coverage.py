"""Coverage mesh: the faces of the wall that a video has seen, as in C3VD's `coverage_mesh.obj`."""

import numpy as np
from jaxtyping import Bool, Int

from col3d.data.datasets.coverage_mesh import CoverageMesh
from col3d.phantom.anatomy import AROUND, Colon

BLOCK = 4
"""Quadrilaterals along each side of one face of the file, which counts as seen if any of them is seen."""


class Coverage:
    """Collects the faces that the rays of a video have hit.

    Args:
        colon: the wall.
    """

    def __init__(self, colon: Colon) -> None:
        self.colon = colon
        self.rings = len(colon.vertices) // AROUND
        self.seen: Bool[np.ndarray, "rows columns"] = np.zeros(
            (-(-(self.rings - 1) // BLOCK), AROUND // BLOCK), bool
        )

    def add(self, triangles: Int[np.ndarray, " n"]) -> None:
        """Mark triangles of the wall as seen; -1 is ignored."""
        ring, column = np.divmod(triangles[triangles >= 0] // 2, AROUND)
        self.seen[ring // BLOCK, column // BLOCK] = True

    def mesh(self) -> CoverageMesh:
        """Return the wall in mm, with two triangles for each face."""
        rings = np.append(np.arange(0, self.rings - 1, BLOCK), self.rings - 1)
        kept = self.colon.vertices.reshape(self.rings, AROUND, 3)[rings, ::BLOCK]
        around = kept.shape[1]
        corner = np.arange(self.seen.size).reshape(self.seen.shape)
        beside = np.roll(corner, -1, axis=1)
        halves = [[corner, beside, beside + around], [corner, beside + around, corner + around]]
        triangles = np.stack([np.stack(half, axis=-1) for half in halves], axis=2).reshape(-1, 3)
        return CoverageMesh(kept.reshape(-1, 3), triangles, np.repeat(self.seen.ravel(), 2))
