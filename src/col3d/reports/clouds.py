"""Write coloured point clouds as PLY files, which every viewer of point clouds and meshes opens."""

from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Float, UInt8

from col3d.io.atomic import write_whole


def write_cloud(path: Path, points: Float[np.ndarray, "n 3"], colours: UInt8[np.ndarray, "n 3"]) -> None:
    """Write points in mm with the colours of their pixels, as binary PLY.

    Raises:
        OSError: it cannot be written.
    """
    cloud = trimesh.PointCloud(points.astype(np.float32), colours)
    write_whole(path, cloud.export(file_type="ply"))
