"""Central cameras: an affine pixel map around a lens that maps points of a plane to directions and back.

A pixel is u = S p + centre with a 2 x 2 `stretch` S. Where the lens is symmetric about its axis, the ray
through the plane point p is (p_x, p_y, g(|p|)), normalised: a pinhole has g = 1 and S = diag(fx, fy);
Scaramuzza's omnidirectional model has a polynomial g. Resizing, cropping, mirroring and rolling an image are
affine maps of its pixels, so every camera is closed under them; mirroring and rolling also turn the vectors
of the scene.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TypeVar

import torch
from jaxtyping import Bool, Float
from torch import Tensor

CameraType = TypeVar("CameraType", bound="Camera")
Matrix2 = tuple[tuple[float, float], tuple[float, float]]
MIN_AHEAD = 1e-3
"""Least z of a ray that has a depth along the optical axis."""
BISECTIONS = 24


@dataclass(frozen=True)
class Camera(ABC):
    """A central camera; see the module's docstring for the model."""

    size_hw: tuple[int, int]
    """Image height and width in pixels."""
    centre: tuple[float, float]
    """Pixel (u, v) of the optical axis."""
    stretch: Matrix2
    """Matrix S of the module's docstring, in pixels per unit of the plane point."""

    @abstractmethod
    def directions(self, plane: Float[Tensor, "*n 2"]) -> Float[Tensor, "*n 3"]:
        """Ray, of any length, through each plane point; NaN where the lens has none."""

    @abstractmethod
    def plane_points(self, points: Float[Tensor, "*n 3"]) -> Float[Tensor, "*n 2"]:
        """Plane point of the direction to each point; NaN where no pixel sees it."""

    def rays(self) -> Float[Tensor, "3 h w"]:
        """Unit viewing direction of every pixel (float32, computed once per camera; do not write into it).

        Pixels outside the image circle have no ray of their own: they get that of the nearest pixel towards
        the optical axis that has one, so that networks get finite numbers. `sees` distinguishes them.
        """
        return _rays(self)

    def sees(self) -> Bool[Tensor, "1 h w"]:
        """Pixels that have a ray less than 90 degrees from the optical axis: where z-depth is defined."""
        return _sees(self)

    def unproject(self, pixels: Float[Tensor, "*n 2"]) -> Float[Tensor, "*n 3"]:
        """Unit ray of each pixel (u, v); NaN outside the image circle."""
        inverse, centre = self._stretch_on(pixels).inverse(), pixels.new_tensor(self.centre)
        ray = self.directions((pixels - centre) @ inverse.T)
        return ray / ray.norm(dim=-1, keepdim=True)

    def project(self, points: Float[Tensor, "*n 3"]) -> Float[Tensor, "*n 2"]:
        """Pixel (u, v) of each point; differentiable. Inverse of `unproject` inside the image circle.

        Directions that no pixel sees get a pixel far outside the image or NaN, never one inside it.
        """
        return self.plane_points(points) @ self._stretch_on(points).T + points.new_tensor(self.centre)

    def resized(self: CameraType, size_hw: tuple[int, int]) -> CameraType:
        """The camera of the image resized to this size: corners stay, pixel centres move by half a pixel."""
        scale_v, scale_u = (new / old for new, old in zip(size_hw, self.size_hw, strict=True))
        offset = (0.5 * scale_u - 0.5, 0.5 * scale_v - 0.5)
        return self._moved(size_hw, ((scale_u, 0.0), (0.0, scale_v)), offset)

    def cropped(self: CameraType, top: int, left: int, height: int, width: int) -> CameraType:
        """The camera of a crop of the image."""
        return self._moved((height, width), ((1.0, 0.0), (0.0, 1.0)), (-float(left), -float(top)))

    def flipped(self: CameraType) -> CameraType:
        """The camera of the image mirrored left to right; x of every ray and vector changes its sign."""
        mirror = ((-1.0, 0.0), (0.0, 1.0))
        return self._moved(self.size_hw, mirror, (self.size_hw[1] - 1.0, 0.0), turn=mirror)

    def rolled(self: CameraType, degrees: float) -> CameraType:
        """The camera of the image rotated about its middle, from x towards y (clockwise in the image).

        Vectors of the scene rotate by the same angle about the optical axis.
        """
        cos, sin = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        turn = ((cos, -sin), (sin, cos))
        mid_u, mid_v = (self.size_hw[1] - 1) / 2, (self.size_hw[0] - 1) / 2
        offset = (mid_u - cos * mid_u + sin * mid_v, mid_v - sin * mid_u - cos * mid_v)
        return self._moved(self.size_hw, turn, offset, turn=turn)

    def _moved(
        self: CameraType,
        size_hw: tuple[int, int],
        linear: Matrix2,
        offset: tuple[float, float],
        turn: Matrix2 = ((1.0, 0.0), (0.0, 1.0)),
    ) -> CameraType:
        """Transform pixels by `linear` and `offset`, and vectors by the orthogonal `turn`: S' = A S T^-1."""
        a, s, t = (torch.tensor(m, dtype=torch.float64) for m in (linear, self.stretch, turn))
        (s00, s01), (s10, s11) = (a @ s @ t.T).tolist()
        centre = (a @ a.new_tensor(self.centre) + a.new_tensor(offset)).tolist()
        return replace(
            self._turned(turn),
            size_hw=(size_hw[0], size_hw[1]),
            centre=(centre[0], centre[1]),
            stretch=((s00, s01), (s10, s11)),
        )

    def _turned(self: CameraType, turn: Matrix2) -> CameraType:
        """The lens for rotated vectors; one that is symmetric about its axis is unchanged."""
        return self

    def _stretch_on(self, like: Tensor) -> Tensor:
        return like.new_tensor(self.stretch)


@lru_cache(maxsize=64)
@torch.inference_mode(False)  # rays of a first call in validation must serve training, too
def _rays(camera: Camera) -> Tensor:
    pixels = _pixels(camera.size_hw)
    rays = camera.unproject(pixels)
    blind = rays.isnan().any(dim=-1)
    rays[blind] = camera.unproject(_nearest_seen(camera, pixels[blind]))
    return rays.permute(2, 0, 1).float().contiguous()


@lru_cache(maxsize=64)
def _sees(camera: Camera) -> Tensor:
    return (camera.unproject(_pixels(camera.size_hw))[..., 2] > MIN_AHEAD)[None]


def _pixels(size_hw: tuple[int, int]) -> Float[Tensor, "h w 2"]:
    v, u = (torch.arange(side, dtype=torch.float64) for side in size_hw)
    return torch.stack(torch.meshgrid(u, v, indexing="xy"), dim=-1)


def _nearest_seen(camera: Camera, pixels: Float[Tensor, "n 2"]) -> Float[Tensor, "n 2"]:
    """The last pixels with a ray on the lines from the optical axis to these, by bisection."""
    centre = pixels.new_tensor(camera.centre)
    seen, blind = pixels.new_zeros(len(pixels), 1), pixels.new_ones(len(pixels), 1)
    for _ in range(BISECTIONS):
        middle = (seen + blind) / 2
        has_ray = camera.unproject(centre + middle * (pixels - centre))[:, 2:].isfinite()
        seen, blind = torch.where(has_ray, middle, seen), torch.where(has_ray, blind, middle)
    return centre + seen * (pixels - centre)


@dataclass(frozen=True)
class RadialCamera(Camera):
    """A central camera that is symmetric about its axis: the ray is (p_x, p_y, g(|p|))."""

    @abstractmethod
    def profile(self, radius: Tensor) -> Tensor:
        """Third coordinate g of the ray through a plane point at this radius."""

    @abstractmethod
    def plane_radius(self, across: Tensor, along: Tensor) -> Tensor:
        """Radius r of the plane point of a direction, given its parts across and along the optical axis."""

    def directions(self, plane: Float[Tensor, "*n 2"]) -> Float[Tensor, "*n 3"]:
        """Rays (p_x, p_y, g(|p|)) through plane points."""
        return torch.cat([plane, self.profile(plane.norm(dim=-1, keepdim=True))], dim=-1)

    def plane_points(self, points: Float[Tensor, "*n 3"]) -> Float[Tensor, "*n 2"]:
        """Plane points of directions: the part across the axis, at the radius of the angle."""
        across, along = points[..., :2].norm(dim=-1, keepdim=True), points[..., 2:]
        radius = self.plane_radius(across, along)
        ahead = along > 0
        on_axis = self.profile(torch.zeros_like(along)) / torch.where(ahead, along, 1.0)
        scale = torch.where(
            across > 0, radius / across.clamp_min(1e-30), torch.where(ahead, on_axis, torch.nan)
        )
        return points[..., :2] * scale


@dataclass(frozen=True)
class PinholeCamera(RadialCamera):
    """A pinhole without distortion: ray = ((u - cx) / fx, (v - cy) / fy, 1)."""

    @classmethod
    def from_focal(
        cls, size_hw: tuple[int, int], fx: float, fy: float, cx: float, cy: float
    ) -> "PinholeCamera":
        """Build from focal lengths and principal point in pixels."""
        return cls(size_hw=size_hw, centre=(cx, cy), stretch=((fx, 0.0), (0.0, fy)))

    @classmethod
    def c3vd(cls) -> "PinholeCamera":
        """The pinhole that published code uses for C3VD, whose lens it does not describe (1080 x 1350)."""
        return cls.from_focal(
            (1080, 1350), 769.807403688120, 769.720558534159, 675.226397736271, 548.903474592445
        )

    @classmethod
    def c3vd_published(cls, size_hw: tuple[int, int]) -> "PinholeCamera":
        """The same pinhole at another size, scaled as in published code: by the ratio of the sizes alone.

        `c3vd().resized(size_hw)` also shifts pixel centres by the half pixel that this omits.
        """
        full = cls.c3vd()
        down, across = size_hw[0] / full.size_hw[0], size_hw[1] / full.size_hw[1]
        fx, fy = full.stretch[0][0] * across, full.stretch[1][1] * down
        return cls.from_focal(size_hw, fx, fy, full.centre[0] * across, full.centre[1] * down)

    def profile(self, radius: Tensor) -> Tensor:
        """The profile of a pinhole: one everywhere."""
        return torch.ones_like(radius)

    def plane_radius(self, across: Tensor, along: Tensor) -> Tensor:
        """Tangent of the angle to the optical axis; NaN behind the camera."""
        return torch.where(along > 0, across / along.clamp_min(1e-30), torch.nan)
