"""Central cameras: an affine pixel map around a radial profile.

A pixel is u = S p + centre with a 2 x 2 `stretch` S, and the ray through the plane point p is
(p_x, p_y, g(|p|)), normalised. A pinhole has g = 1 and S = diag(fx, fy); Scaramuzza's omnidirectional
model has a polynomial g. Resizing, cropping, mirroring and rolling an image are affine maps of its pixels,
so every camera is closed under them; mirroring and rolling also turn the vectors of the scene.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TypeVar

import torch
from jaxtyping import Float
from torch import Tensor

CameraType = TypeVar("CameraType", bound="Camera")
Matrix2 = tuple[tuple[float, float], tuple[float, float]]
NEWTON_STEPS = 12
BY_COLUMNS, BY_ROWS = "[[c, e], [d, 1]]", "[[c, d], [e, 1]]"
"""How the numbers c, d, e of an omnidirectional calibration fill its stretch matrix S: programs differ."""
BEYOND_CORNERS = 1.15
"""Largest radius of a calibration that names none, as a multiple of that of the farthest corner."""


@dataclass(frozen=True)
class Camera(ABC):
    """A central camera; see the module for its model."""

    size_hw: tuple[int, int]
    """Image height and width in pixels."""
    centre: tuple[float, float]
    """Pixel (u, v) of the optical axis."""
    stretch: Matrix2
    """S of the module's text, in pixels per unit of the plane point."""

    @abstractmethod
    def profile(self, radius: Tensor) -> Tensor:
        """Third coordinate g of the ray through a plane point at this radius."""

    @abstractmethod
    def plane_radius(self, across: Tensor, along: Tensor) -> Tensor:
        """Radius r of the plane point of a direction, given its parts across and along the optical axis."""

    def rays(self) -> Float[Tensor, "3 h w"]:
        """Unit viewing direction of every pixel (float32, computed once per camera; do not write into it)."""
        return _rays(self)

    def unproject(self, pixels: Float[Tensor, "*n 2"]) -> Float[Tensor, "*n 3"]:
        """Unit ray of each pixel (u, v)."""
        inverse, centre = self._stretch_on(pixels).inverse(), pixels.new_tensor(self.centre)
        plane = (pixels - centre) @ inverse.T
        ray = torch.cat([plane, self.profile(plane.norm(dim=-1, keepdim=True))], dim=-1)
        return ray / ray.norm(dim=-1, keepdim=True)

    def project(self, points: Float[Tensor, "*n 3"]) -> Float[Tensor, "*n 2"]:
        """Pixel (u, v) of each point; differentiable. Inverse of `unproject` inside the image circle.

        Directions that no pixel sees get a pixel far outside the image or NaN, never one inside it.
        """
        across, along = points[..., :2].norm(dim=-1, keepdim=True), points[..., 2:]
        radius = self.plane_radius(across, along)
        ahead = along > 0
        on_axis = self.profile(torch.zeros_like(along)) / torch.where(ahead, along, 1.0)
        scale = torch.where(
            across > 0, radius / across.clamp_min(1e-30), torch.where(ahead, on_axis, torch.nan)
        )
        return points[..., :2] * scale @ self._stretch_on(points).T + points.new_tensor(self.centre)

    def resized(self: CameraType, size_hw: tuple[int, int]) -> CameraType:
        """The camera of the image resized to this size: corners stay put, centres move by half a pixel."""
        scale_v, scale_u = (new / old for new, old in zip(size_hw, self.size_hw, strict=True))
        offset = (0.5 * scale_u - 0.5, 0.5 * scale_v - 0.5)
        return self._moved(size_hw, ((scale_u, 0.0), (0.0, scale_v)), offset)

    def cropped(self: CameraType, top: int, left: int, height: int, width: int) -> CameraType:
        """The camera of the image cut out at this place."""
        return self._moved((height, width), ((1.0, 0.0), (0.0, 1.0)), (-float(left), -float(top)))

    def flipped(self: CameraType) -> CameraType:
        """The camera of the image mirrored left to right; x of every ray and vector changes its sign."""
        mirror = ((-1.0, 0.0), (0.0, 1.0))
        return self._moved(self.size_hw, mirror, (self.size_hw[1] - 1.0, 0.0), turn=mirror)

    def rolled(self: CameraType, degrees: float) -> CameraType:
        """The camera of the image turned about its middle, from x towards y (clockwise as one looks at it).

        Vectors of the scene turn by the same angle about the optical axis.
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
        """Pixels move by `linear` and `offset`, vectors turn by the orthogonal `turn`: S' = A S T^-1."""
        a, s, t = (torch.tensor(m, dtype=torch.float64) for m in (linear, self.stretch, turn))
        (s00, s01), (s10, s11) = (a @ s @ t.T).tolist()
        centre = (a @ a.new_tensor(self.centre) + a.new_tensor(offset)).tolist()
        return replace(
            self,
            size_hw=(size_hw[0], size_hw[1]),
            centre=(centre[0], centre[1]),
            stretch=((s00, s01), (s10, s11)),
        )

    def _stretch_on(self, like: Tensor) -> Tensor:
        return like.new_tensor(self.stretch)


@lru_cache(maxsize=64)
@torch.inference_mode(False)  # first asked for during a validation, the rays must serve training too
def _rays(camera: Camera) -> Tensor:
    height, width = camera.size_hw
    v, u = torch.meshgrid(
        torch.arange(height, dtype=torch.float64), torch.arange(width, dtype=torch.float64), indexing="ij"
    )
    return camera.unproject(torch.stack([u, v], dim=-1)).permute(2, 0, 1).float().contiguous()


@dataclass(frozen=True)
class PinholeCamera(Camera):
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
        """The same at another size as published code scales it: by the ratio of the sizes alone.

        `c3vd().resized(size_hw)` keeps to the half pixel by which pixel centres shift besides.
        """
        full = cls.c3vd()
        down, across = size_hw[0] / full.size_hw[0], size_hw[1] / full.size_hw[1]
        fx, fy = full.stretch[0][0] * across, full.stretch[1][1] * down
        return cls.from_focal(size_hw, fx, fy, full.centre[0] * across, full.centre[1] * down)

    def profile(self, radius: Tensor) -> Tensor:
        """One everywhere."""
        return torch.ones_like(radius)

    def plane_radius(self, across: Tensor, along: Tensor) -> Tensor:
        """Tangent of the angle to the optical axis; NaN behind the camera."""
        return torch.where(along > 0, across / along.clamp_min(1e-30), torch.nan)


@dataclass(frozen=True)
class OmnidirectionalCamera(Camera):
    """Scaramuzza's omnidirectional model: g(r) = a0 + a1 r + a2 r^2 + a3 r^3 + a4 r^4.

    References:
        Scaramuzza, Martinelli, Siegwart: A Flexible Technique for Accurate Omnidirectional Camera
        Calibration and Structure from Motion, ICVS 2006, eq. 3 and 4 (z is forward here).
    """

    polynomial: tuple[float, float, float, float, float]
    """Coefficients a0 to a4."""
    max_radius: float
    """Largest radius |p| that the calibration covers: where the search for a projection starts."""

    @classmethod
    def from_calibration(
        cls,
        size_hw: tuple[int, int],
        centre: tuple[float, float],
        polynomial: tuple[float, float, float, float, float],
        stretch: Matrix2 = ((1.0, 0.0), (0.0, 1.0)),
        max_radius: float | None = None,
    ) -> "OmnidirectionalCamera":
        """Build from the numbers of a calibration.

        Args:
            size_hw: height and width of its images in pixels.
            centre: (cx, cy), with (0, 0) the centre of the top left pixel.
            polynomial: a0 to a4, with a0 positive (z forward).
            stretch: S; `stretch_matrix` fills it from c, d, e.
            max_radius: that it covers; a little beyond the farthest corner when absent.
        """
        height, width = size_hw
        corners = [math.dist(centre, (u, v)) for u in (0, width - 1) for v in (0, height - 1)]
        return cls(size_hw, centre, stretch, polynomial, max_radius or BEYOND_CORNERS * max(corners))

    @classmethod
    def c3vd(cls) -> "OmnidirectionalCamera":
        """The Olympus CF-HQ190L of C3VD at 1080 x 1350; its rays reach 73 degrees off the axis.

        The stretch matrix is that of the program which rendered the data set's truth. The data set's example
        loader transposes it, which turns rays by 0.2 degrees and contradicts its depth (`docs/errata.md`).

        References:
            DurrLab/C3VD on GitHub: `render/Intrinsics.h`, `render/Render.cu`.
        """
        return cls(
            size_hw=(1080, 1350),
            centre=(678.544839263292, 542.975887548343),
            stretch=stretch_matrix(0.999986882249990, 0.00288273829525059, -0.00296316513429569),
            polynomial=(
                769.243600037458,
                0.0,
                -0.000812770624150226,
                6.25674244578925e-07,
                -1.19662182144280e-09,
            ),
            max_radius=1000.0,
        )

    @classmethod
    def c3vdv2(cls) -> "OmnidirectionalCamera":
        """The colonoscope of C3VDv2 at 1080 x 1350, by the data set's `camera_intrinsics.txt`."""
        return cls(
            size_hw=(1080, 1350),
            centre=(677.739464094188, 543.057997844875),
            stretch=stretch_matrix(0.9999, 1.10e-4, -1.83e-4),
            polynomial=(
                767.733695862103,
                0.0,
                -0.000592506426558248,
                -2.69440266600040e-07,
                -2.16380341010063e-10,
            ),
            max_radius=1000.0,
        )

    def stretch_forms(self) -> dict[str, "OmnidirectionalCamera"]:
        """This lens, read as S = [[c, e], [d, 1]]; with the transpose of S; and with S taken as 1.

        What a calibration's c, d, e mean can be told by measuring with all three, on images of its own size.
        """
        (s00, s01), (s10, s11) = self.stretch
        others = {BY_ROWS: ((s00, s10), (s01, s11)), "identity": ((1.0, 0.0), (0.0, 1.0))}
        return {BY_COLUMNS: self} | {form: replace(self, stretch=s) for form, s in others.items()}

    def profile(self, radius: Tensor) -> Tensor:
        """The polynomial g."""
        a0, a1, a2, a3, a4 = self.polynomial
        return a0 + radius * (a1 + radius * (a2 + radius * (a3 + radius * a4)))

    def plane_radius(self, across: Tensor, along: Tensor) -> Tensor:
        """Root of across * g(r) = along * r, by Newton's method from the rim inwards, in double precision.

        The function is concave and falls, so that the steps come down to the root from above. The last step
        alone is differentiated, which gives the exact derivative of the root.
        """
        wide_across, wide_along = across.double(), along.double()
        with torch.no_grad():
            radius = torch.full_like(wide_across, self.max_radius)
            for _ in range(NEWTON_STEPS):
                radius = radius - self._newton_step(wide_across, wide_along, radius)
        radius = radius - self._newton_step(wide_across, wide_along, radius)
        same_side = self.profile(radius) * wide_along >= 0
        seen = (radius > -1e-6) & (radius < self.max_radius) & same_side
        return torch.where(seen, radius, torch.nan).to(across.dtype)

    def _newton_step(self, across: Tensor, along: Tensor, radius: Tensor) -> Tensor:
        _, a1, a2, a3, a4 = self.polynomial
        slope = a1 + radius * (2 * a2 + radius * (3 * a3 + radius * 4 * a4))
        return (across * self.profile(radius) - along * radius) / (across * slope - along)


def stretch_matrix(c: float, d: float, e: float, form: str = BY_COLUMNS) -> Matrix2:
    """The stretch matrix S, pixel = S p + centre, of a calibration's numbers c, d and e.

    Args:
        c: about 1.
        d: about 0.
        e: about 0.
        form: `[[c, e], [d, 1]]`, as C3VD's renderer has it, or `[[c, d], [e, 1]]`, as MATLAB prints it.
    """
    return ((c, e), (d, 1.0)) if form == BY_COLUMNS else ((c, d), (e, 1.0))
