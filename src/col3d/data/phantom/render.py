"""From a colon and a pose to the files' pixels: cast the camera's rays, shade and encode."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Float64, UInt8, UInt16

from col3d.data.octagon import octagon_mask
from col3d.data.phantom.anatomy import Colon
from col3d.data.phantom.appearance import Mucosa, develop
from col3d.geometry import Camera

MAX_DEPTH = 100.0
"""Depth in mm of the highest code."""
FULL_CODE = 65535
GRAZING = 1e-3
"""Least cosine at which a stored normal faces its ray; interpolated ones may turn away at outlines."""


@dataclass(frozen=True)
class Frame:
    """The encoded pixels of one frame."""

    color: UInt8[np.ndarray, "h w 3"]
    depth: UInt16[np.ndarray, "h w"]
    normals: UInt16[np.ndarray, "h w 3"]


@dataclass(frozen=True)
class Hits:
    """Where the rays of a frame meet the wall, in camera axes and mm."""

    points: Float32[np.ndarray, "n 3"]
    normals: Float32[np.ndarray, "n 3"]
    world: Float32[np.ndarray, "n 3"]
    attributes: Float32[np.ndarray, "n a"]
    hit: Bool[np.ndarray, " n"]


class Renderer:
    """Renders frames of one colon.

    Args:
        colon: the wall.
        mucosa: its surface.
        camera: lens and size of the frames.
    """

    def __init__(self, colon: Colon, mucosa: Mucosa, camera: Camera) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self.colon, self.mucosa, self.size_hw = colon, mucosa, camera.size_hw
        self.shown = octagon_mask(camera.size_hw)[0].numpy()
        rays = camera.rays().numpy()
        self.rays: Float32[np.ndarray, "n 3"] = np.ascontiguousarray(rays[:, self.shown].T)
        middle = rays[:, self.size_hw[0] // 2, self.size_hw[1] // 2 : self.size_hw[1] // 2 + 2]
        self.pixel = float(np.linalg.norm(middle[:, 1] - middle[:, 0]))
        self.table = np.concatenate([colon.normals, mucosa.attributes], axis=1)
        self.triangles = np.ascontiguousarray(colon.triangles.T, dtype=np.intp)
        self.scene = EmbreeScene(robust=True)
        TriangleMesh(self.scene, colon.vertices, colon.triangles)

    def frame(self, pose: Float64[np.ndarray, "4 4"], random: np.random.Generator) -> Frame:
        """Render one frame.

        Args:
            pose: from camera axes to the world.
            random: source of the sensor's noise.
        """
        hits = self.cast(pose)
        radiance = self.mucosa.radiance(hits.points, hits.normals, hits.world, hits.attributes, self.pixel)
        radiance[~hits.hit] = 0
        color = develop(radiance, self.rays[:, 2], random)
        depth = np.clip(np.rint(hits.points[:, 2] * (FULL_CODE / MAX_DEPTH)), 1, FULL_CODE)
        depth = np.where(hits.hit, depth, 0).astype(np.uint16)
        normals = np.rint((hits.normals + 1) * (FULL_CODE / 2)) * hits.hit[:, None]
        return Frame(
            color=self._image(np.rint(color * 255).astype(np.uint8), self._border(random)),
            depth=self._image(depth, np.zeros(self.size_hw, np.uint16)),
            normals=self._image(normals.astype(np.uint16), np.zeros((*self.size_hw, 3), np.uint16)),
        )

    def cast(self, pose: Float64[np.ndarray, "4 4"]) -> Hits:
        """Meet the wall along every ray inside the octagon."""
        turn = pose[:3, :3].astype(np.float32)
        world_rays = _turned(self.rays, turn)
        origin = np.broadcast_to(pose[:3, 3].astype(np.float32), world_rays.shape)
        found = self.scene.run(np.ascontiguousarray(origin), world_rays, output=True)
        hit = found["primID"] >= 0
        distance = np.where(hit, found["tfar"], np.float32(MAX_DEPTH))[:, None]
        values = self._interpolated(np.where(hit, found["primID"], 0), found["u"], found["v"])
        return Hits(
            points=self.rays * distance,
            normals=facing(_turned(values[:, :3], turn.T), self.rays),
            world=origin + world_rays * distance,
            attributes=values[:, 3:],
            hit=hit,
        )

    def _interpolated(self, triangle: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Normals and attributes at barycentric coordinates."""
        first, second, third = self.triangles.take(triangle, axis=1)
        return (
            self.table.take(first, axis=0) * (1 - u - v)[:, None]
            + self.table.take(second, axis=0) * u[:, None]
            + self.table.take(third, axis=0) * v[:, None]
        )

    def _border(self, random: np.random.Generator) -> UInt8[np.ndarray, "h w 3"]:
        """What surrounds the octagon: nearly black."""
        return random.integers(0, 6, (*self.size_hw, 1), np.uint8).repeat(3, axis=2)

    def _image(self, pixels: np.ndarray, background: np.ndarray) -> np.ndarray:
        background[self.shown] = pixels
        return background


def facing(
    normals: Float32[np.ndarray, "n 3"], rays: Float32[np.ndarray, "n 3"]
) -> Float32[np.ndarray, "n 3"]:
    """Unit normals, turned by as little as makes each face its ray: n . ray <= -GRAZING."""
    normals = normals / np.linalg.norm(normals, axis=-1, keepdims=True)
    along = np.einsum("ni,ni->n", normals, rays)[:, None]
    excess = np.clip(along + GRAZING, 0, None)
    turned = normals - excess * rays
    return turned / np.linalg.norm(turned, axis=-1, keepdims=True)


def _turned(
    vectors: Float32[np.ndarray, "n 3"], turn: Float32[np.ndarray, "3 3"]
) -> Float32[np.ndarray, "n 3"]:
    """Each vector turned. Not a matrix product: its threads would wait on each other in every process."""
    return np.einsum("ij,nj->ni", turn, vectors)
