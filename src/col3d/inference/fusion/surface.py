"""Triangle mesh of a surface, and distances of points from it."""

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
    """A triangle mesh in world coordinates, in mm.

    Attributes:
        vertices: coordinates of the vertices.
        triangles: indices of the three vertices of each triangle.
        colours: RGB of the vertices, or None.
    """

    vertices: Float[np.ndarray, "n 3"]
    triangles: Int[np.ndarray, "t 3"]
    colours: UInt8[np.ndarray, "n 3"] | None = None

    def distance(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, " m"]:
        """Compute the distance of each point from the nearest point of the surface, in mm."""
        import open3d

        queries = open3d.core.Tensor(points.astype(np.float32))
        distances: np.ndarray = self._scene.compute_distance(queries).numpy()
        return distances

    def samples(self, spacing: float, seed: int = 0) -> Float[np.ndarray, "m 3"]:
        """Sample points uniformly at random over the surface, one for each square of `spacing` mm."""
        mesh = self.as_trimesh()
        count = max(int(np.ceil(mesh.area / spacing**2)), 1)
        points, _ = trimesh.sample.sample_surface(mesh, count, seed=seed)
        return np.asarray(points)

    def write(self, path: Path, colours: UInt8[np.ndarray, "n 3"] | None = None) -> None:
        """Write binary PLY, with the given colours or the surface's own.

        Raises:
            OSError: the file cannot be written.
        """
        mesh = self.as_trimesh()
        shown = self.colours if colours is None else colours
        if shown is not None:
            mesh.visual = trimesh.visual.ColorVisuals(mesh, vertex_colors=shown)
        content = mesh.export(file_type="ply")
        assert isinstance(content, bytes)
        write_whole(path, content)

    def as_trimesh(self) -> trimesh.Trimesh:
        """Convert to trimesh; the order of vertices is kept."""
        return trimesh.Trimesh(self.vertices, self.triangles, process=False)

    @cached_property
    def _scene(self) -> Any:
        import open3d

        scene = open3d.t.geometry.RaycastingScene()
        corners = open3d.core.Tensor(self.vertices.astype(np.float32))
        scene.add_triangles(corners, open3d.core.Tensor(self.triangles.astype(np.uint32)))
        return scene
