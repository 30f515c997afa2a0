"""Renderer of frames: casts the camera's rays on a colon, shades them, and encodes every modality."""

from dataclasses import dataclass

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float32, Float64, Int, UInt8, UInt16

from col3d.data.datasets.c3vd import MAX_DEPTH
from col3d.data.datasets.flow import MAX_FLOW
from col3d.data.datasets.octagon import octagon_mask
from col3d.data.datasets.release import FULL_CODE
from col3d.geometry import Camera
from col3d.phantom.anatomy import Colon
from col3d.phantom.appearance import Look
from col3d.phantom.sensor import develop, light_of
from col3d.phantom.shading import Hits, Mucosa, Radiance, turned

GRAZING = 1e-3
"""Least cosine between a stored normal and its reversed ray; interpolation alone may turn it away."""
SHADOW_GRID = 135
"""Least height in pixels of the grid on which shadows are cast; it is coarse because shadows are soft."""
SHADED_GRID = 540
"""Least height in pixels of the grid on which colour is computed."""
BAND = 16384
"""Number of rays that are processed at once, so that their data stay in the cache."""
OFF_WALL = 0.02  # distance in mm from the wall at which secondary rays start or end


@dataclass(frozen=True)
class Frame:
    """The encoded pixels of one frame; the first frame of a video has no flow."""

    color: UInt8[np.ndarray, "h w 3"]
    depth: UInt16[np.ndarray, "h w"]
    normals: UInt16[np.ndarray, "h w 3"]
    occlusion: UInt8[np.ndarray, "h w"]
    flow: UInt16[np.ndarray, "h w 3"] | None


class Renderer:
    """Renders frames of one colon.

    Args:
        colon: the wall.
        mucosa: its surface.
        look: lamps and sensor.
        camera: camera with the lens and the size of the frames.
    """

    def __init__(self, colon: Colon, mucosa: Mucosa, look: Look, camera: Camera) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self.colon, self.mucosa, self.look, self.camera = colon, mucosa, look, camera
        self.size_hw = camera.size_hw
        self.shown: Bool[np.ndarray, "h w"] = octagon_mask(camera.size_hw)[0].numpy()
        rays = camera.rays().numpy()
        self.off_axis: Float32[np.ndarray, "h w"] = rays[2]
        self.rays: Float32[np.ndarray, "n 3"] = np.ascontiguousarray(rays[:, self.shown].T)
        middle = rays[:, self.size_hw[0] // 2, self.size_hw[1] // 2 : self.size_hw[1] // 2 + 2]
        self.pixel = float(np.linalg.norm(middle[:, 1] - middle[:, 0]))
        self.places = np.argwhere(self.shown)[:, ::-1].astype(np.float32)
        self.bands = _bands(len(self.rays))
        table = np.concatenate([colon.normals, mucosa.attributes], axis=1)
        self.corners: Float32[np.ndarray, "t 3 c"] = table[colon.triangles]
        self.first = np.ascontiguousarray(colon.triangles[:, 0])
        self.scene = EmbreeScene(robust=True)
        TriangleMesh(self.scene, colon.vertices, colon.triangles)

    def frame(
        self,
        pose: Float64[np.ndarray, "4 4"],
        previous: Float64[np.ndarray, "4 4"] | None,
        random: np.random.Generator,
    ) -> tuple[Frame, Hits]:
        """Render one frame.

        Args:
            pose: pose of the frame, camera to world.
            previous: pose of the previous frame.
            random: source of the sensor's noise.

        Returns:
            The frame, and the points of the wall that it sees.
        """
        hits = self.cast(pose)
        distance = np.sqrt(np.einsum("ni,ni->n", hits.points, hits.points))
        light = self._light(hits, distance, pose)
        hit = hits.triangle >= 0
        depth = np.clip(hits.points[:, 2] * (FULL_CODE / MAX_DEPTH), 0, FULL_CODE)  # the cast below truncates
        normals = (hits.normals + 1) * (FULL_CODE / 2) * hit[:, None]
        hidden = self.hides_another(hits, distance) & hit
        frame = Frame(
            color=develop(light, self.off_axis, self.shown, self.look.sensor, random),
            depth=self._image(np.where(hit, depth, 0).astype(np.uint16)),
            normals=self._image(normals.astype(np.uint16)),
            occlusion=self._image(np.where(hidden, np.uint8(255), np.uint8(0))),
            flow=None if previous is None else self._image(self._flow(hits, previous)),
        )
        return frame, hits

    def cast(self, pose: Float64[np.ndarray, "4 4"]) -> Hits:
        """Intersect every ray inside the octagon with the wall."""
        return Hits.joined([self._cast(pose, self.rays[band]) for band in self.bands])

    def _cast(self, pose: Float64[np.ndarray, "4 4"], seen: Float32[np.ndarray, "n 3"]) -> Hits:
        turn = pose[:3, :3].astype(np.float32)
        rays = turned(seen, turn)
        origin = np.broadcast_to(pose[:3, 3].astype(np.float32), rays.shape)
        result = self.scene.run(np.ascontiguousarray(origin), rays, output=True)
        triangle = result["primID"]
        met = np.maximum(triangle, 0)
        distance = np.where(triangle >= 0, result["tfar"], np.float32(MAX_DEPTH))[:, None]
        u, v = result["u"], result["v"]
        weights = np.stack([1 - u - v, u, v], axis=1)
        values = np.einsum("nk,nkc->nc", weights, self.corners.take(met, axis=0))
        facing = np.ascontiguousarray(values[:, :3])
        return Hits(
            points=seen * distance,
            normals=facing_rays(turned(facing, turn.T), seen),
            world=origin + rays * distance,
            facing=facing,
            attributes=values[:, 3:],
            vertex=self.first.take(met),
            triangle=triangle,
            turn=turn,
        )

    def _light(
        self, hits: Hits, distance: Float32[np.ndarray, " n"], pose: Float64[np.ndarray, "4 4"]
    ) -> Float32[np.ndarray, "h w 3"]:
        """Compute the linear light of a frame; C3VD's size is shaded at half resolution and enlarged."""
        lit, step = self._lit(hits, pose), max(self.size_hw[0] // SHADED_GRID, 1)
        grid, chosen = self._every(step)
        seen, lit, pixel = hits.band(chosen), lit[chosen], step * self.pixel
        light, mucosa = self.look.light, self.mucosa
        radiance = Radiance.joined(
            [mucosa.radiance(seen.band(b), light, lit[b], pixel) for b in _bands(len(chosen))]
        )
        coarse = grid[::step, ::step]
        picture = light_of(radiance, distance[chosen], coarse, self.look, pixel)
        if step == 1:
            return picture
        known = np.maximum(self._enlarged(coarse.astype(np.float32), step), 1e-3)
        return self._enlarged(picture, step) / known[..., None] * self.shown[..., None]

    def _every(self, step: int) -> tuple[Bool[np.ndarray, "h w"], Int[np.ndarray, " k"]]:
        """Select the octagon's pixels in every `step`-th row and column: mask, and indices of their rays."""
        grid = np.zeros_like(self.shown)
        grid[::step, ::step] = self.shown[::step, ::step]
        return grid, np.flatnonzero(grid[self.shown])

    def _enlarged(self, coarse: np.ndarray, step: int) -> np.ndarray:
        """Interpolate values at every `step`-th row and column to all pixels."""
        at_pixels = np.array([[step, 0, 0], [0, step, 0]], np.float32)
        return cv2.warpAffine(coarse, at_pixels, self.size_hw[::-1], borderMode=cv2.BORDER_REPLICATE)

    def hides_another(self, hits: Hits, distance: Float32[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
        """Whether each ray hits the wall again behind its visible point, at a depth of 100 mm or less."""
        beyond = distance + OFF_WALL
        rays = turned(self.rays, hits.turn)
        start = hits.world + OFF_WALL * rays
        return self._blocked(start, rays, np.maximum(np.float32(MAX_DEPTH) / self.rays[:, 2] - beyond, 0))

    def _lit(self, hits: Hits, pose: Float64[np.ndarray, "4 4"]) -> Float32[np.ndarray, "n k"]:
        """Compute the share of each lamp that reaches each point, on a coarse grid for soft shadows."""
        step = max(self.size_hw[0] // SHADOW_GRID, 1)
        grid, chosen = self._every(step)
        normals = turned(hits.normals[chosen], hits.turn)
        start = hits.world[chosen] + np.float32(5 * OFF_WALL) * normals
        reached = []
        for lamp in self.look.light.lamps:
            place = (pose[:3, :3] @ np.asarray(lamp) + pose[:3, 3]).astype(np.float32)
            way = place - start
            length = np.sqrt(np.einsum("ni,ni->n", way, way))
            dark = self._blocked(start, way / length[:, None], length)
            reached.append(1 - np.float32(self.look.light.shadow) * self._spread(dark, grid, step))
        return np.stack(reached, axis=1)

    def _spread(
        self, dark: Bool[np.ndarray, " k"], grid: Bool[np.ndarray, "h w"], step: int
    ) -> Float32[np.ndarray, " n"]:
        """Interpolate values of the coarse grid to all pixels, smoothed over a cell of the grid."""
        coarse, known = np.zeros(self.size_hw, np.float32), grid.astype(np.float32)
        coarse[grid] = dark
        soft, weight = (cv2.blur(part[::step, ::step], (3, 3)) for part in (coarse, known))
        return self._enlarged(soft / np.maximum(weight, 1e-3), step)[self.shown]

    def _flow(self, hits: Hits, previous: Float64[np.ndarray, "4 4"]) -> UInt16[np.ndarray, "n 3"]:
        """Encode the motion from this frame to the previous one, as C3VD's renderer does.

        The code is 0 where the point is outside the previous frame, or occluded there by another triangle.
        """
        bands = [self._flow_of(hits.band(b), self.places[b], previous) for b in self.bands]
        return np.concatenate(bands)

    def _flow_of(
        self, hits: Hits, places: Float32[np.ndarray, "n 2"], previous: Float64[np.ndarray, "4 4"]
    ) -> UInt16[np.ndarray, "n 3"]:
        turn, place = previous[:3, :3].astype(np.float32), previous[:3, 3].astype(np.float32)
        points = turned(hits.world - place, turn.T)
        u, v = np.nan_to_num(self.camera.project(torch.from_numpy(points)).numpy(), nan=-1e6).T
        motion = np.stack([u, v], axis=1) - places
        height, width = self.size_hw
        inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
        chosen = np.flatnonzero(inside & (hits.triangle >= 0))
        way = hits.world[chosen] - place
        way /= np.sqrt(np.einsum("ni,ni->n", way, way))[:, None]
        origin = np.ascontiguousarray(np.broadcast_to(place, way.shape))
        met = self.scene.run(origin, np.ascontiguousarray(way), output=True)["primID"]
        chosen = chosen[met == hits.triangle[chosen]]
        codes = np.zeros((len(motion), 3), np.uint16)
        codes[chosen, :2] = np.clip((motion[chosen] / MAX_FLOW + 1) * (FULL_CODE / 2), 0, FULL_CODE)
        return codes

    def _blocked(
        self, origin: np.ndarray, direction: np.ndarray, length: Float32[np.ndarray, " n"]
    ) -> Bool[np.ndarray, " n"]:
        """Whether rays of these lengths are blocked by the wall."""
        result = self.scene.run(
            np.ascontiguousarray(origin, np.float32),
            np.ascontiguousarray(direction, np.float32),
            dists=np.ascontiguousarray(length, np.float32),
            query="OCCLUDED",
        )
        return np.asarray(result) >= 0

    def _image(self, pixels: np.ndarray) -> np.ndarray:
        image = np.zeros((*self.size_hw, *pixels.shape[1:]), pixels.dtype)
        image[self.shown] = pixels
        return image


def _bands(count: int) -> list[slice]:
    return [slice(start, start + BAND) for start in range(0, count, BAND)]


def facing_rays(
    normals: Float32[np.ndarray, "n 3"], rays: Float32[np.ndarray, "n 3"]
) -> Float32[np.ndarray, "n 3"]:
    """Return unit normals, rotated as little as makes each face its ray: n . ray <= -GRAZING."""
    normals = normals / np.linalg.norm(normals, axis=-1, keepdims=True)
    along = np.einsum("ni,ni->n", normals, rays)[:, None]
    excess = np.clip(along + GRAZING, 0, None)
    facing = normals - excess * rays
    return facing / np.linalg.norm(facing, axis=-1, keepdims=True)
