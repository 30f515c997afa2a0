"""A surface of triangles, and how far points are from it."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from jaxtyping import Float, Int, UInt8

from col3d.io.atomic import write_whole


@dataclass(frozen=True)
class Surface:
    """Triangles in world coordinates, in mm.

    Attributes:
        vertices: their corners.
        triangles: three corners each.
        colours: RGB of the corners; None where there are none.
    """

    vertices: Float[np.ndarray, "n 3"]
    triangles: Int[np.ndarray, "t 3"]
    colours: UInt8[np.ndarray, "n 3"] | None = None

    def distance(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, " m"]:
        """Distance of each point from the nearest one of the surface, in mm."""
        import open3d

        found = self._scene.compute_distance(open3d.core.Tensor(points.astype(np.float32)))
        distances: np.ndarray = found.numpy()
        return distances

    def samples(self, spacing: float, seed: int = 0) -> Float[np.ndarray, "m 3"]:
        """Points spread evenly at random over the surface, one for each square of this side in mm."""
        mesh = self.as_trimesh()
        count = max(int(np.ceil(mesh.area / spacing**2)), 1)
        points, _ = trimesh.sample.sample_surface(mesh, count, seed=seed)
        return np.asarray(points)

    def write(self, path: Path, colours: UInt8[np.ndarray, "n 3"] | None = None) -> None:
        """Write binary PLY, with these colours or its own.

        Raises:
            OSError: it cannot be written.
        """
        mesh = self.as_trimesh()
        shown = self.colours if colours is None else colours
        if shown is not None:
            mesh.visual = trimesh.visual.ColorVisuals(mesh, vertex_colors=shown)
        content = mesh.export(file_type="ply")
        assert isinstance(content, bytes)
        write_whole(path, content)

    def as_trimesh(self) -> trimesh.Trimesh:
        """The same for trimesh, vertices in their order."""
        return trimesh.Trimesh(self.vertices, self.triangles, process=False)

    @cached_property
    def _scene(self) -> Any:
        import open3d

        scene = open3d.t.geometry.RaycastingScene()
        corners = open3d.core.Tensor(self.vertices.astype(np.float32))
        scene.add_triangles(corners, open3d.core.Tensor(self.triangles.astype(np.uint32)))
        return scene
