"""Kannala-Brandt fisheye, as OpenCV's `cv2.fisheye` and COLMAP's OPENCV_FISHEYE."""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

from col3d.geometry.camera import Matrix2, RadialCamera
from col3d.geometry.inverse import inverse

WIDEST = math.radians(179.0)
"""Largest angle to the optical axis; beyond it the azimuth is ill-defined."""
NEGLIGIBLE = 1e-30
Distortion = tuple[float, float, float, float]


@dataclass(frozen=True)
class FisheyeCamera(RadialCamera):
    """A fisheye: the plane point of a direction at an angle t to the axis has the radius
    r(t) = t (1 + k1 t^2 + k2 t^4 + k3 t^6 + k4 t^8).

    The lens reaches to the angle where r stops growing. Pixels beyond that radius have no ray.

    References:
        Kannala, Brandt: A Generic Camera Model and Calibration Method for Conventional, Wide-Angle, and
        Fish-Eye Lenses, TPAMI 28(8), 2006, eq. 6 without its asymmetric terms.
    """

    distortion: Distortion
    """k1 to k4."""

    @classmethod
    def from_focal(
        cls,
        size_hw: tuple[int, int],
        focal: tuple[float, float],
        centre: tuple[float, float],
        distortion: Distortion = (0.0, 0.0, 0.0, 0.0),
        skew: float = 0.0,
    ) -> "FisheyeCamera":
        """Build from a matrix K = [[fx, skew, cx], [0, fy, cy], [0, 0, 1]] and k1 to k4.

        Args:
            size_hw: height and width of the image in pixels.
            focal: (fx, fy) in pixels.
            centre: (cx, cy), with (0, 0) the centre of the top left pixel.
            distortion: k1 to k4.
            skew: pixels; OpenCV's alpha times fx.
        """
        stretch: Matrix2 = ((focal[0], skew), (0.0, focal[1]))
        return cls(size_hw, centre, stretch, distortion)

    @property
    def widest_angle(self) -> float:
        """Radians from the optical axis to which the lens reaches."""
        return _widest(self.distortion)

    def profile(self, radius: Tensor) -> Tensor:
        """The profile r / tan(t); NaN beyond the image circle."""
        angle = inverse(self._radius, self._slope, self.widest_angle, radius)
        ahead = radius > 0
        sine = torch.where(ahead, angle.sin(), 1.0)
        return torch.where(ahead, radius.double() * angle.cos() / sine, 1.0).to(radius.dtype)

    def plane_radius(self, across: Tensor, along: Tensor) -> Tensor:
        """Radius r of the angle; NaN beyond the widest one."""
        angle = torch.atan2(across.double(), along.double())
        return torch.where(angle <= self.widest_angle, self._radius(angle), torch.nan).to(across.dtype)

    def _radius(self, angle: Tensor) -> Tensor:
        k1, k2, k3, k4 = self.distortion
        s = angle.square()
        return angle * (1 + s * (k1 + s * (k2 + s * (k3 + s * k4))))

    def _slope(self, angle: Tensor) -> Tensor:
        k1, k2, k3, k4 = self.distortion
        s = angle.square()
        return 1 + s * (3 * k1 + s * (5 * k2 + s * (7 * k3 + s * 9 * k4)))


@lru_cache(maxsize=64)
def _widest(distortion: Distortion) -> float:
    k1, k2, k3, k4 = distortion
    fold = first_root([9 * k4, 7 * k3, 5 * k2, 3 * k1, 1.0])
    return min(math.sqrt(fold), WIDEST)


def first_root(coefficients: list[float]) -> float:
    """Least positive real root of a polynomial, its highest power first; infinity where there is none."""
    values = np.array(coefficients)
    values[np.abs(values) < NEGLIGIBLE * np.abs(values).max()] = 0.0  # their roots are beyond any number
    roots = np.roots(values)
    real = roots[np.abs(roots.imag) <= 1e-9 * np.abs(roots)].real
    return float(min(real[real > 0], default=math.inf))
