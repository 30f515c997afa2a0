"""Truncated signed distance field, into which frames of any central camera are averaged.

Open3D stores the sparse blocks of voxels and extracts the surface. Its own integration supports only
pinholes, so that voxels are projected here by the camera's own model. Distances are measured along the
viewing ray.

References:
    Curless, Levoy: A Volumetric Method for Building Complex Models from Range Images, SIGGRAPH 1996.
    Dong, Lao, Kaess, Koltun: ASH, A Modern Framework for Parallel Spatial Hashing in 3D Perception, 2021.
"""

from functools import lru_cache

import numpy as np
import open3d
import torch
from jaxtyping import Bool, Float, Int, UInt8
from open3d import core

from col3d.geometry import Camera, RadialCamera, points_from_depth
from col3d.inference.fusion.surface import Surface

ANGLES = 16384
"""Number of angles in the table of directions."""
BLOCK = 8
"""Number of voxels along a side of a block."""
BLOCKS = 4096
"""Initial number of blocks; more are added when needed."""


class Volume:
    """Averages frames into a surface.

    Args:
        voxel: side of a voxel in mm.
        truncation: distance in voxels behind a frame's surface beyond which the frame is ignored.
    """

    def __init__(self, voxel: float, truncation: float = 4.0) -> None:
        self.voxel, self.truncation = voxel, truncation * voxel
        self.reach = truncation
        self.grid = open3d.t.geometry.VoxelBlockGrid(
            attr_names=("tsdf", "weight", "color"),
            attr_dtypes=(core.float32, core.float32, core.float32),
            attr_channels=((1), (1), (3)),
            voxel_size=voxel,
            block_resolution=BLOCK,
            block_count=BLOCKS,
        )

    def add(
        self,
        depth: Float[torch.Tensor, "1 h w"],
        mask: Bool[torch.Tensor, "1 h w"],
        image: UInt8[torch.Tensor, "3 h w"],
        camera: Camera,
        pose: Float[np.ndarray, "4 4"],
    ) -> None:
        """Average a frame into the field.

        Args:
            depth: depth along the optical axis, in mm.
            mask: pixels whose depth is known.
            image: RGB.
            camera: camera of the frame, at its size.
            pose: camera to world, in mm.
        """
        mask = mask & camera.sees()
        points = points_from_depth(depth[None], camera.rays())[0][:, mask[0]].numpy()
        if points.size == 0:
            return
        world = points.T @ pose[:3, :3].T + pose[:3, 3]
        cloud = open3d.t.geometry.PointCloud(core.Tensor(world.astype(np.float32)))
        blocks = self.grid.compute_unique_block_coordinates(cloud, self.reach)
        self.grid.hashmap().activate(blocks)
        places, _ = self.grid.hashmap().find(blocks)
        centres, index = self.grid.voxel_coordinates_and_flattened_indices(places)
        seen, sdf, colours = self._seen(centres.numpy(), depth, mask, image, camera, pose)
        self._average(index.numpy()[seen], sdf, colours)

    def surface(self, least: int = 1) -> Surface:
        """Extract the surface of the voxels that at least `least` frames have seen."""
        if self.grid.hashmap().size() == 0:
            return Surface(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int64))
        mesh = self.grid.extract_triangle_mesh(weight_threshold=least - 0.5)
        if mesh.vertex.positions.shape[0] == 0:
            return Surface(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int64))
        colours = (mesh.vertex.colors.numpy() * 255).round().clip(0, 255).astype(np.uint8)
        triangles = mesh.triangle.indices.numpy().astype(np.int64)
        return _in_order(mesh.vertex.positions.numpy(), triangles, colours)

    def _seen(
        self,
        voxels: Float[np.ndarray, "n 3"],
        depth: torch.Tensor,
        mask: torch.Tensor,
        image: torch.Tensor,
        camera: Camera,
        pose: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Find the voxels that a frame sees, their signed distance over the truncation, and their colour."""
        local = torch.from_numpy(((voxels - pose[:3, 3]) @ pose[:3, :3]).astype(np.float32))
        height, width = camera.size_hw
        pixels = projected(camera, local).round()
        inside = ((pixels >= 0) & (pixels < pixels.new_tensor([width, height]))).all(dim=1)
        u, v = torch.where(inside[:, None], pixels, 0.0).long().unbind(dim=1)
        known = inside & mask[0, v, u]
        distance = depth[0] / camera.rays()[2]
        along = distance[v, u] - local.norm(dim=1)
        seen = known & (along >= -self.truncation)
        sdf = (along[seen] / self.truncation).clamp_max(1.0)
        colours = image[:, v[seen], u[seen]].T.float()  # Open3D divides by 255
        return seen.numpy(), sdf.numpy(), colours.numpy()

    def _average(self, index: np.ndarray, sdf: np.ndarray, colours: np.ndarray) -> None:
        tsdf, weight, colour = (
            self.grid.attribute(name).reshape((-1, channels)).numpy()
            for name, channels in (("tsdf", 1), ("weight", 1), ("color", 3))
        )
        before = weight[index]
        tsdf[index] = (tsdf[index] * before + sdf[:, None]) / (before + 1)
        colour[index] = (colour[index] * before + colours) / (before + 1)
        weight[index] = before + 1


def _in_order(
    vertices: Float[np.ndarray, "n 3"], triangles: Int[np.ndarray, "t 3"], colours: UInt8[np.ndarray, "n 3"]
) -> Surface:
    """Sort vertices and triangles by position, because their order depends on the threads of Open3D."""
    order = np.lexsort(vertices.T[::-1])
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    corners = place[triangles]
    turn = (corners.argmin(axis=1)[:, None] + np.arange(3)) % 3  # the same triangle, smallest index first
    corners = np.take_along_axis(corners, turn, axis=1)
    return Surface(vertices[order], corners[np.lexsort(corners.T[::-1])], colours[order])


def projected(camera: Camera, points: Float[torch.Tensor, "n 3"]) -> Float[torch.Tensor, "n 2"]:
    """Project points as `camera.project` does, to 1e-3, with a table of radii for speed with many voxels."""
    if not isinstance(camera, RadialCamera):
        return camera.project(points)
    angles, radii = _radii(camera)
    across = points[:, :2].norm(dim=1)
    angle = torch.atan2(across, points[:, 2])
    radius = np.interp(angle.numpy(), angles, radii, right=np.nan)
    scale = torch.from_numpy(radius.astype(np.float32)) / across.clamp_min(1e-12)
    plane = points[:, :2] * scale[:, None]
    return plane @ plane.new_tensor(camera.stretch).T + plane.new_tensor(camera.centre)


@lru_cache(maxsize=4)
def _radii(camera: RadialCamera) -> tuple[np.ndarray, np.ndarray]:
    """Tabulate the radius in the image plane of directions by their angle to the optical axis."""
    angles = torch.linspace(0, np.pi, ANGLES, dtype=torch.float64)[1:, None]
    radii = camera.plane_radius(angles.sin(), angles.cos())[:, 0].numpy()
    return np.concatenate([[0.0], angles[:, 0].numpy()]), np.concatenate([[0.0], radii])
