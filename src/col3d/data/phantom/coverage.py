"""Which faces of the wall a video has seen, as C3VD's `coverage_mesh.obj`."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Int

from col3d.data.phantom.anatomy import AROUND, Colon

BLOCK = 4
"""Quadrilaterals of the mesh along either side of one face of the file; it is seen where any of them is."""


class Coverage:
    """The union of all faces that the rays of a video have met.

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
        """Count these triangles of the wall as seen; -1 is none."""
        ring, column = np.divmod(triangles[triangles >= 0] // 2, AROUND)
        self.seen[ring // BLOCK, column // BLOCK] = True

    def write(self, path: Path) -> None:
        """Vertices in mm, then faces of four corners: `usemtl 0` those that were seen, `usemtl 1` others."""
        with path.open("w", encoding="utf-8") as file:
            file.writelines(f"{line}\n" for line in self._lines())

    def _lines(self) -> Iterator[str]:
        rings = np.append(np.arange(0, self.rings - 1, BLOCK), self.rings - 1)
        kept = self.colon.vertices.reshape(self.rings, AROUND, 3)[rings, ::BLOCK]
        yield "# faces seen by the video are of material 0, unseen ones of material 1; mm"
        yield from (f"v {x:.3f} {y:.3f} {z:.3f}" for x, y, z in kept.reshape(-1, 3))
        around = kept.shape[1]
        corner = np.arange(self.seen.size).reshape(self.seen.shape) + 1
        beside = np.roll(corner, -1, axis=1)
        faces = np.stack([corner, beside, beside + around, corner + around], axis=-1)
        for label, chosen in ((0, self.seen), (1, ~self.seen)):
            yield f"usemtl {label}"
            yield from (f"f {a} {b} {c} {d}" for a, b, c, d in faces[chosen])
