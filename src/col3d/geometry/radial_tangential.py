"""A pinhole with radial and tangential distortion, as OpenCV's `cv2.calibrateCamera` fits it."""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from col3d.geometry.camera import Camera, Matrix2
from col3d.geometry.fisheye import first_root
from col3d.geometry.inverse import inverse

STEPS = 12
MISSES = 1e-9
"""Largest distance in the plane between a distorted point and the requested one."""
FARTHEST = 1000.0
"""Tangent of the widest angle to the optical axis, where the distortion does not fold before."""
Radial = tuple[float, float, float, float, float, float]


@dataclass(frozen=True)
class RadialTangentialCamera(Camera):
    """A pinhole whose plane points are moved: with (x, y) = (X / Z, Y / Z) and s = x^2 + y^2,

    R = (1 + k1 s + k2 s^2 + k3 s^3) / (1 + k4 s + k5 s^2 + k6 s^3),
    x' = x R + 2 p1 x y + p2 (s + 2 x^2) and y' = y R + p1 (s + 2 y^2) + 2 p2 x y.

    The model is valid up to the radius where it folds: where points farther out are mapped inwards again.
    Directions beyond have no pixel, and pixels beyond no ray.

    References:
        Brown: Decentering Distortion of Lenses, Photogrammetric Engineering 32(3), 1966; with the rational
        form of OpenCV's `calib3d` module.
    """

    radial: Radial
    """k1, k2, k3 of the numerator and k4, k5, k6 of the denominator; OpenCV's vectors have another order."""
    tangential: tuple[float, float]
    """p1 and p2."""

    @classmethod
    def from_focal(
        cls,
        size_hw: tuple[int, int],
        focal: tuple[float, float],
        centre: tuple[float, float],
        radial: Radial,
        tangential: tuple[float, float] = (0.0, 0.0),
        skew: float = 0.0,
    ) -> "RadialTangentialCamera":
        """Build from a matrix K = [[fx, skew, cx], [0, fy, cy], [0, 0, 1]] and its distortion.

        Args:
            size_hw: height and width of the image in pixels.
            focal: (fx, fy) in pixels.
            centre: (cx, cy), with (0, 0) the centre of the top left pixel.
            radial: k1 to k6.
            tangential: p1 and p2.
            skew: pixels.
        """
        stretch: Matrix2 = ((focal[0], skew), (0.0, focal[1]))
        return cls(size_hw, centre, stretch, radial, tangential)

    @property
    def widest_tangent(self) -> float:
        """Radius (x, y) at which the radial distortion folds."""
        return _fold(self.radial)

    def directions(self, plane: Float[Tensor, "*n 2"]) -> Float[Tensor, "*n 3"]:
        """(x, y, 1) of distorted points (x', y'), by Newton's method from the root of the radial part."""
        wide = plane.double()
        with torch.no_grad():
            x, y = self._radial_start(wide)
            for _ in range(STEPS):
                right, down = self._newton_step(x, y, wide)
                x, y = x - right, y - down
                if float(torch.maximum(right.abs(), down.abs()).nan_to_num(0.0).sum()) == 0:
                    break
        right, down = self._newton_step(x, y, wide)  # differentiated, for the exact derivative
        point = torch.stack([x - right, y - down, torch.ones_like(x)], dim=-1)
        missed = (self._distorted(point[..., 0], point[..., 1]) - wide).norm(dim=-1)
        holds = self._holds(point[..., 0], point[..., 1]) & (missed < MISSES)
        return torch.where(holds[..., None], point, torch.nan).to(plane.dtype)

    def plane_points(self, points: Float[Tensor, "*n 3"]) -> Float[Tensor, "*n 2"]:
        """(x', y'); NaN behind the camera and beyond the fold."""
        ahead = points[..., 2] > 0
        x, y = (points[..., :2] / torch.where(ahead, points[..., 2], 1.0)[..., None]).unbind(dim=-1)
        holds = ahead & self._holds(x, y)
        x, y = (
            torch.where(holds, x, 0.0),
            torch.where(holds, y, 0.0),
        )  # so that all have a gradient
        return torch.where(holds[..., None], self._distorted(x, y), torch.nan)

    def _turned(self, turn: Matrix2) -> "RadialTangentialCamera":
        """Tangential distortion is 2 p (t . p) + |p|^2 t with t = (p2, p1), so t rotates as points do."""
        p1, p2 = self.tangential
        (a, b), (c, d) = turn
        return replace(self, tangential=(c * p2 + d * p1, a * p2 + b * p1))

    def _holds(self, x: Tensor, y: Tensor) -> Tensor:
        """Where the model is one to one: before the fold, and with a positive determinant."""
        across, off, down = self._derivatives(x, y)
        return ((x.square() + y.square()).sqrt() < self.widest_tangent) & (across * down > off.square())

    def _radial_start(self, plane: Float[Tensor, "*n 2"]) -> tuple[Tensor, Tensor]:
        radius = plane.norm(dim=-1)
        limit, largest = 1.0, float(radius.max()) if radius.numel() else 0.0
        while limit < self.widest_tangent and float(self._ring(torch.tensor(limit).double())) < largest:
            limit *= 2
        limit = min(limit, self.widest_tangent)
        start = inverse(self._ring, self._ring_slope, limit, radius).nan_to_num(0.99 * limit)
        scale = torch.where(radius > 0, start / radius.clamp_min(1e-300), 1.0)
        x, y = (plane * scale[..., None]).unbind(dim=-1)
        return x, y

    def _newton_step(self, x: Tensor, y: Tensor, plane: Tensor) -> tuple[Tensor, Tensor]:
        right, down = (self._distorted(x, y) - plane).unbind(dim=-1)
        xx, xy, yy = self._derivatives(x, y)
        area = xx * yy - xy.square()
        area = torch.where(area.abs() < 1e-12, 1e-12, area)
        return (yy * right - xy * down) / area, (xx * down - xy * right) / area

    def _distorted(self, x: Tensor, y: Tensor) -> Float[Tensor, "*n 2"]:
        p1, p2 = self.tangential
        s = x.square() + y.square()
        factor, _ = self._factor(s)
        right = x * factor + 2 * p1 * x * y + p2 * (s + 2 * x.square())
        down = y * factor + p1 * (s + 2 * y.square()) + 2 * p2 * x * y
        return torch.stack([right, down], dim=-1)

    def _derivatives(self, x: Tensor, y: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """dx'/dx, dx'/dy = dy'/dx and dy'/dy."""
        p1, p2 = self.tangential
        factor, slope = self._factor(x.square() + y.square())
        across = factor + 2 * x.square() * slope + 2 * p1 * y + 6 * p2 * x
        off = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
        return across, off, factor + 2 * y.square() * slope + 6 * p1 * y + 2 * p2 * x

    def _ring(self, radius: Tensor) -> Tensor:
        return radius * self._factor(radius.square())[0]

    def _ring_slope(self, radius: Tensor) -> Tensor:
        factor, slope = self._factor(radius.square())
        return factor + 2 * radius.square() * slope

    def _factor(self, s: Tensor) -> tuple[Tensor, Tensor]:
        """R and dR/ds."""
        k1, k2, k3, k4, k5, k6 = self.radial
        above, below = 1 + s * (k1 + s * (k2 + s * k3)), 1 + s * (k4 + s * (k5 + s * k6))
        rise, fall = k1 + s * (2 * k2 + s * 3 * k3), k4 + s * (2 * k5 + s * 3 * k6)
        return above / below, (rise * below - above * fall) / below.square()


@lru_cache(maxsize=64)
def _fold(radial: Radial) -> float:
    """Radius at which r R(r^2) stops growing, or its denominator vanishes."""
    k1, k2, k3, k4, k5, k6 = radial
    above, below = np.poly1d([k3, k2, k1, 1.0]), np.poly1d([k6, k5, k4, 1.0])
    s = np.poly1d([1.0, 0.0])
    growth = above * below + 2 * s * (above.deriv() * below - above * below.deriv())
    least = min(first_root(list(growth.coeffs)), first_root(list(below.coeffs)))
    return min(math.sqrt(least), FARTHEST)
