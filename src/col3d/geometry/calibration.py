"""Read omnidirectional calibrations: C3VD's numbers, OCamCalib's text, MATLAB's object.

The three disagree about axes, origin, sign and how c, d, e fill the stretch matrix; here each becomes an
`OmnidirectionalCamera` with x right, y down, z forward and (0, 0) the centre of the top left pixel.
"""

import math
from collections.abc import Mapping
from typing import Any

from col3d.geometry.omnidirectional import BY_COLUMNS, BY_ROWS, OmnidirectionalCamera, stretch_matrix

OCAMCALIB = "#polynomial coefficients"
"""First words of `calib_results.txt`."""
MATLAB = "MappingCoefficients"
"""A property of MATLAB's `fisheyeIntrinsics`."""
COEFFICIENTS = ("a0", "a1", "a2", "a3", "a4")
STRETCH = ("c", "d", "e")
PUBLISHED_TO = 1e-7
"""Largest difference of c, d and e from those that a data set publishes."""
LARGEST = 65535
"""Largest side in pixels: no image is larger, and a wrong number must not fill the memory."""


def from_numbers(given: Mapping[str, Any]) -> OmnidirectionalCamera:
    """A camera from `size` (or `height` and `width`), cx, cy, a0 to a4, and c, d, e with their `stretch`.

    `stretch` says which entries c, d and e are: `[[c, e], [d, 1]]` or `[[c, d], [e, 1]]`.

    Raises:
        ValueError: says what is missing or not what it should be.
    """
    rest = dict(given)
    size = rest.pop("size") if "size" in rest else [rest.pop("height", None), rest.pop("width", None)]
    size_hw = checked_size(numbers("size", size, 2))
    cx, cy = numbers("cx, cy", [rest.pop("cx", None), rest.pop("cy", None)], 2)
    values = [rest.pop(name, 0.0 if name == "a1" else None) for name in COEFFICIENTS]
    a0, a1, a2, a3, a4 = numbers(", ".join(COEFFICIENTS), values, 5)
    if a0 <= 0:
        raise ValueError(f"a0: expected a number above 0, for z is forward, got {a0}")
    c, d, e = numbers("c, d, e", [rest.pop(n, v) for n, v in zip(STRETCH, (1.0, 0.0, 0.0), strict=True)], 3)
    stretch = stretch_matrix(c, d, e, _form(rest.pop("stretch", None), c, d, e))
    check_rest(rest)
    return OmnidirectionalCamera.from_calibration(size_hw, (cx, cy), (a0, a1, a2, a3, a4), stretch)


def _form(named: Any, c: float, d: float, e: float) -> str:
    """Arrangement of c, d, e in the matrix; where d equals e, both are the same."""
    written = "".join(str(named).split()) if named is not None else ""
    for form in (BY_COLUMNS, BY_ROWS):
        if written == "".join(form.split()):
            return form
    if named is None and (d == e or _is_published(c, d, e)):
        return BY_COLUMNS
    actual = "nothing" if named is None else repr(named)
    raise ValueError(
        f"stretch: expected the entries that c={c}, d={d}, e={e} are, {BY_COLUMNS!r} (C3VD's renderer) or "
        f"{BY_ROWS!r} (MATLAB, C3VD's example loader), got {actual}"
    )


def _is_published(c: float, d: float, e: float) -> bool:
    """Whether these are the numbers of C3VD or C3VDv2, whose renderer's arrangement is known."""
    for camera in (OmnidirectionalCamera.c3vd(), OmnidirectionalCamera.c3vdv2()):
        (known_c, known_e), (known_d, _) = camera.stretch
        if max(abs(c - known_c), abs(d - known_d), abs(e - known_e)) < PUBLISHED_TO:
            return True
    return False


def from_ocamcalib(text: str) -> OmnidirectionalCamera:
    """A camera from `calib_results.txt` of Scaramuzza's OCamCalib.

    There x is the row and y the column, z points backwards, and (row, column) = [[c, d], [e, 1]] (x, y) +
    centre, so that S = [[1, e], [d, c]] here.

    Raises:
        ValueError: says what is missing or not what it should be.
    """
    lines = [line.split() for line in text.splitlines() if line.strip() and not line.startswith("#")]
    try:
        direct, _, centre, affine, size = ([float(number) for number in line] for line in lines)
    except ValueError:
        raise ValueError(
            "expected five lines of numbers, as OCamCalib writes them: polynomial, its inverse, centre, "
            f"c d e, image size; got {len(lines)}"
        ) from None
    count, *coefficients = direct
    if count != len(coefficients) or not 1 <= count <= len(COEFFICIENTS):
        raise ValueError(f"polynomial: expected 1 to 5 coefficients behind their number, got {direct}")
    a0, a1, a2, a3, a4 = [-a for a in coefficients] + [0.0] * (len(COEFFICIENTS) - len(coefficients))
    if a0 <= 0:
        raise ValueError(f"polynomial: expected a negative first coefficient, got {coefficients[0]}")
    row, column = numbers("center", centre, 2)
    c, d, e = numbers("affine parameters", affine, 3)
    size_hw = checked_size(numbers("image size", size, 2))
    return OmnidirectionalCamera.from_calibration(
        size_hw, (column, row), (a0, a1, a2, a3, a4), ((1.0, e), (d, c))
    )


def from_matlab(given: Mapping[str, Any]) -> OmnidirectionalCamera:
    """A camera from `jsonencode(struct(intrinsics))` of a MATLAB `fisheyeIntrinsics`.

    MATLAB counts pixels from 1, and its StretchMatrix is S.

    Raises:
        ValueError: says what is missing or not what it should be.
    """
    size_hw = checked_size(numbers("ImageSize", given.get("ImageSize"), 2))
    cx, cy = numbers("DistortionCenter", given.get("DistortionCenter"), 2)
    a0, a2, a3, a4 = numbers(MATLAB, given.get(MATLAB), 4)
    rows = given.get("StretchMatrix", [[1.0, 0.0], [0.0, 1.0]])
    if not isinstance(rows, list) or len(rows) != 2:
        raise ValueError(f"StretchMatrix: expected two rows of two numbers, got {rows!r}")
    (s00, s01), (s10, s11) = (numbers("StretchMatrix", row, 2) for row in rows)
    return OmnidirectionalCamera.from_calibration(
        size_hw, (cx - 1, cy - 1), (a0, 0.0, a2, a3, a4), ((s00, s01), (s10, s11))
    )


def numbers(name: str, values: Any, count: int) -> tuple[float, ...]:
    """Check that values are the expected count of finite numbers.

    Raises:
        ValueError: names the field and the values.
    """
    if not isinstance(values, list | tuple) or len(values) != count:
        raise ValueError(f"{name}: expected {count} numbers, got {values!r}")
    if not all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        raise ValueError(f"{name}: expected numbers, got {values!r}")
    try:
        converted = tuple(float(value) for value in values)
    except OverflowError:
        converted = (math.inf,)
    if not all(math.isfinite(value) for value in converted):
        raise ValueError(f"{name}: expected finite numbers, got {str(values)[:80]}")
    return converted


def checked_size(size_hw: tuple[float, ...]) -> tuple[int, int]:
    """Check height and width in pixels.

    Raises:
        ValueError: they are not whole numbers from 1 on.
    """
    if not all(1 <= side <= LARGEST and side == int(side) for side in size_hw):
        raise ValueError(f"size: expected whole numbers of pixels from 1 to {LARGEST}, got {size_hw}")
    return int(size_hw[0]), int(size_hw[1])


def check_rest(given: Mapping[str, Any]) -> None:
    """Refuse fields that were not read.

    Raises:
        ValueError: names them.
    """
    if given:
        raise ValueError(f"{', '.join(given)}: no such field")
