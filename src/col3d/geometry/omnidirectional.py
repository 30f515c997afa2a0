"""Scaramuzza's omnidirectional camera, and the meaning of its calibrations' numbers."""

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from col3d.geometry.camera import Matrix2, RadialCamera

NEWTON_STEPS = 12
BY_COLUMNS, BY_ROWS = "[[c, e], [d, 1]]", "[[c, d], [e, 1]]"
"""How the numbers c, d, e of an omnidirectional calibration fill its stretch matrix S: programs differ."""
BEYOND_CORNERS = 1.15
"""Default largest radius of a calibration, as a multiple of that of the farthest corner."""


@dataclass(frozen=True)
class OmnidirectionalCamera(RadialCamera):
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
            max_radius: largest radius that it covers; a little beyond the farthest corner when absent.
        """
        height, width = size_hw
        corners = [math.dist(centre, (u, v)) for u in (0, width - 1) for v in (0, height - 1)]
        return cls(size_hw, centre, stretch, polynomial, max_radius or BEYOND_CORNERS * max(corners))

    @classmethod
    def c3vd(cls) -> "OmnidirectionalCamera":
        """The Olympus CF-HQ190L of C3VD at 1080 x 1350; its rays reach 73 degrees off the axis.

        The stretch matrix is that of the program which rendered the data set's truth. The data set's example
        loader transposes it, which rotates rays by 0.2 degrees and contradicts its depth (`docs/errata.md`).

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
        """This lens, read as S = [[c, e], [d, 1]]; with the transpose of S; and with S as the identity.

        Measurements with all three, on images of its own size, show what a calibration's c, d, e mean.
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

        The function is concave and decreasing, so that the steps approach the root from above. Only the last
        step is differentiated, which gives the exact derivative of the root.
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
