"""Build a camera from named numbers as in OpenCV: a matrix or focal lengths, and distortion."""

import math
from collections.abc import Mapping
from typing import Any

from col3d.geometry.calibration import check_rest, checked_size, numbers
from col3d.geometry.camera import Camera, PinholeCamera
from col3d.geometry.camera_text import flattened
from col3d.geometry.fisheye import FisheyeCamera
from col3d.geometry.radial_tangential import RadialTangentialCamera

HOW_TO = "fit a pinhole, radial_tangential, fisheye (k1 to k4) or omnidirectional (polynomial a0 to a4) model"
EITHER = "expected pinhole, radial_tangential, fisheye or omnidirectional (polynomial), got nothing"
ALIASES = {
    "width": ("w", "imagewidth", "imagew", "cols"),
    "height": ("h", "imageheight", "imageh", "rows"),
    "fx": ("flx", "fu"),
    "fy": ("fly", "fv"),
    "f": ("focal", "focallength"),
    "cx": ("ppx", "u0", "pu"),
    "cy": ("ppy", "v0", "pv"),
    "k": (
        *("cameramatrix", "intrinsicmatrix", "intrinsics", "intrinsic", "cameraintrinsics"),
        *("matrix", "mtx", "camk"),
    ),
    "d": (
        *("distortioncoefficients", "distortioncoeffs", "distortioncoeff", "distortionparameters"),
        *("distcoefficients", "distcoeffs", "distcoeff", "distortion", "dist", "coeffs"),
    ),
    "model": ("cameramodel", "cameratype", "type", "lens"),
    "distortionmodel": ("distortiontype",),
}
"""Names of fields -> other programs' names of them, reduced to letters and digits in lower case."""
NAMES = {other: name for name, others in ALIASES.items() for other in others}
PERSPECTIVE = (
    *("pinhole", "perspective", "opencv", "fullopencv", "simplepinhole", "simpleradial", "radial", "linear"),
    *("plumbbob", "rationalpolynomial", "radtan", "radialtangential", "pinholeradtan", "brown", "none"),
    *("brownconrady", "distortionbrownconrady", "distortionnone"),
)
FISHEYE = (
    *("fisheye", "fisheyeopencv", "opencvfisheye", "simpleradialfisheye", "radialfisheye", "pinholeequi"),
    *("equidistant", "equi", "kannalabrandt", "kannalabrandt4", "kannalabrandt8", "kb4", "kb8"),
    *("pinholeequidistant", "pinholefisheye"),
)
OTHER_LENSES = {"xi", "alpha", "beta", "s1", "s2", "s3", "s4", "taux", "tauy", "omega", "a0"}
"""Fields of unsupported lenses, which must not be ignored."""
RADIAL, TANGENTIAL = ("k1", "k2", "k3", "k4", "k5", "k6"), ("p1", "p2")
VECTORS = {
    4: ("k1", "k2", "p1", "p2"),
    5: ("k1", "k2", "p1", "p2", "k3"),
    8: ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
}
"""OpenCV's order of distortion, by its length; there are longer ones, for thin prisms and tilted sensors."""
LONGER = (12, 14)
REMARKS = (
    "name",
    "cameraname",
    "cameraid",
    "comment",
    "description",
    "rms",
    "classname",
    "fps",
    "date",
    "depthscale",
)
"""Fields that are ignored: they do not describe a lens."""


def camera_from_numbers(given: Mapping[str, Any]) -> Camera:
    """Build a pinhole, with or without distortion, or a fisheye; its size is (0, 0) if none is given.

    Pixel centres are at whole numbers.

    Args:
        given: size = [height, width], or width and height; K, or fx, fy, cx, cy, and skew; k1 to k6, p1, p2
            or a vector of distortion; a model. Under these names or others of `ALIASES`.

    Raises:
        ValueError: says what is missing or not what it should be.
    """
    rest = renamed(given)
    for name in REMARKS:
        rest.pop(name, None)
    if isinstance(rest.get("k"), int | float):  # COLMAP's name of k1, where there is no other
        rest["k1"] = rest.pop("k") if "k1" not in rest else rest["k1"]
    size_hw = _size(rest)
    focal, centre, skew = _intrinsics(rest)
    is_fisheye = _is_fisheye(rest)
    distortion = _distortion(rest, is_fisheye)
    if others := rest.keys() & OTHER_LENSES:
        raise ValueError(f"{', '.join(sorted(others))}: of a lens that is not read; {HOW_TO}")
    check_rest(rest)
    if is_fisheye is None and not distortion.keys() & {*TANGENTIAL, "k5", "k6"} and distortion.get("k4"):
        raise ValueError(f"model: {EITHER}; k1 to k4 are of a fisheye or of radial_tangential")
    if is_fisheye:
        k1, k2, k3, k4 = (distortion.get(name, 0.0) for name in RADIAL[:4])
        return FisheyeCamera.from_focal(size_hw, focal, centre, (k1, k2, k3, k4), skew)
    k1, k2, k3, k4, k5, k6 = (distortion.get(name, 0.0) for name in RADIAL)
    p1, p2 = (distortion.get(name, 0.0) for name in TANGENTIAL)
    if any(distortion.values()):
        radial, tangential = (k1, k2, k3, k4, k5, k6), (p1, p2)
        return RadialTangentialCamera.from_focal(size_hw, focal, centre, radial, tangential, skew)
    return PinholeCamera(size_hw, centre, ((focal[0], skew), (0.0, focal[1])))


def renamed(given: Mapping[str, Any]) -> dict[str, Any]:
    """The fields under the names that are used here.

    Raises:
        ValueError: a field is given twice.
    """
    fields: dict[str, Any] = {}
    for name, value in given.items():
        bare = "".join(letter for letter in str(name).lower() if letter.isalnum())
        field = NAMES.get(bare, bare)
        if field in fields:
            raise ValueError(f"{name}: given twice, under this name and another")
        fields[field] = value
    return fields


def _size(rest: dict[str, Any]) -> tuple[int, int]:
    """Height and width; (0, 0) where none is given."""
    if isinstance(given := rest.pop("imagesize", None), list):
        raise ValueError(f"image_size: expected height and width under their names, got {given}")
    height, width = rest.pop("height", None), rest.pop("width", None)
    if "size" in rest:
        if height is not None or width is not None:
            raise ValueError("size: given twice, as size and as height and width")
        height, width = numbers("size", rest.pop("size"), 2)
    if height is None and width is None:
        return (0, 0)
    return checked_size(numbers("height, width", [height, width], 2))


def _intrinsics(rest: dict[str, Any]) -> tuple[tuple[float, float], tuple[float, float], float]:
    """Focal lengths, centre and skew in pixels."""
    skew = numbers("skew", [rest.pop("skew", 0.0)], 1)[0]
    if "k" in rest:
        if twice := rest.keys() & {"f", "fx", "fy", "cx", "cy"}:
            raise ValueError(f"{', '.join(sorted(twice))}: given twice, in a matrix as well")
        fx, fy, cx, cy, skew = _matrix(rest.pop("k"))
    else:
        if "f" in rest:
            if rest.keys() & {"fx", "fy"}:
                raise ValueError("f: given twice, as fx and fy as well")
            rest["fx"] = rest["fy"] = rest.pop("f")
        names = ("fx", "fy", "cx", "cy")
        fx, fy, cx, cy = numbers(", ".join(names), [rest.pop(name, None) for name in names], 4)
    if fx <= 0 or fy <= 0:
        raise ValueError(f"fx, fy: expected numbers above 0, got {fx} and {fy}")
    return (fx, fy), (cx, cy), skew


def _matrix(given: Any) -> tuple[float, float, float, float, float]:
    """fx, fy, cx, cy and skew of K = [[fx, skew, cx], [0, fy, cy], [0, 0, 1]], or of its transpose."""
    flat = flattened(given)
    if isinstance(flat, list) and len(flat) == 4:
        fx, fy, cx, cy = numbers("K", flat, 4)
        return fx, fy, cx, cy, 0.0
    if isinstance(flat, list) and len(flat) == 16:  # a 4 x 4 matrix
        if [flat[i] for i in (3, 7, 11, 12, 13, 14, 15)] != [0, 0, 0, 0, 0, 0, 1]:
            raise ValueError("K: expected three rows of three numbers, got four that move points")
        flat = [*flat[0:3], *flat[4:7], *flat[8:11]]
    count = len(flat) if isinstance(flat, list) else 0
    if count != 9:
        raise ValueError(f"K: expected three rows of three numbers, got {count} numbers")
    a, b, c, d, e, f, g, h, i = numbers("K", flat, 9)
    if (c, f) == (0, 0) and (g, h) != (0, 0):
        b, c, d, f, g, h = d, g, b, h, c, f
    if (d, g, h, i) != (0, 0, 0, 1):
        raise ValueError(f"K: expected [[fx, skew, cx], [0, fy, cy], [0, 0, 1]], got {str(given)[:120]}")
    return a, e, c, f, b


def _is_fisheye(rest: dict[str, Any]) -> bool | None:
    """Whether the model is a fisheye; None where no field names a model."""
    given = [rest.pop(name) for name in ("model", "distortionmodel") if name in rest]
    if "isfisheye" in rest or "fisheyemodel" in rest:
        flag = rest.pop("isfisheye", None) or rest.pop("fisheyemodel", None)
        given.append("fisheye" if flag in (1, True, "1", "true") else "pinhole")
    bare = ["".join(letter for letter in str(name).lower() if letter.isalnum()) for name in given]
    for name, whole in zip(bare, given, strict=True):
        if name not in (*PERSPECTIVE, *FISHEYE):
            raise ValueError(f"model: {str(whole)[:60]!r} is not read; {HOW_TO}")
    families = {name in FISHEYE for name in bare if name not in ("pinhole", "none", "perspective")}
    if len(families) > 1:
        raise ValueError(f"model: expected one, got {' and '.join(map(str, given))}")
    return families.pop() if families else (False if bare else None)


def _distortion(rest: dict[str, Any], is_fisheye: bool | None) -> dict[str, float]:
    """Coefficients of distortion by their names."""
    named = {name: rest.pop(name) for name in (*RADIAL, *TANGENTIAL) if name in rest}
    coefficients = dict(zip(named, numbers(", ".join(named), list(named.values()), len(named)), strict=True))
    vector = flattened(rest.pop("d", None))
    if isinstance(vector, int | float):
        vector = [vector]
    if vector:
        if named:
            raise ValueError(f"{', '.join(named)}: given twice, in a vector of distortion as well")
        coefficients = _from_vector(vector, is_fisheye)
    if is_fisheye and (
        wrong := [name for name in coefficients if name not in RADIAL[:4] and coefficients[name]]
    ):
        raise ValueError(f"{', '.join(wrong)}: a fisheye has k1 to k4 alone; {HOW_TO}")
    return coefficients


def _from_vector(vector: Any, is_fisheye: bool | None) -> dict[str, float]:
    count = len(vector) if isinstance(vector, list) else 0
    values = numbers("distortion", vector, count)
    if not any(values):
        return {}
    if is_fisheye:
        if count != 4:
            raise ValueError(f"distortion: expected the four numbers of a fisheye, got {count}")
        return dict(zip(RADIAL[:4], values, strict=True))
    if count == 4 and is_fisheye is None:
        raise ValueError(f"model: {EITHER}; four numbers of distortion are of a fisheye or k1, k2, p1, p2")
    if count in LONGER and not any(values[8:]):
        count = 8
    if count not in VECTORS:
        known = ", ".join(map(str, VECTORS))
        raise ValueError(
            f"distortion: expected {known} numbers (k1, k2, p1, p2, k3, k4, k5, k6), got {count}"
            + (f", some of a thin prism or a tilted sensor; {HOW_TO}" if count in LONGER else "")
        )
    return dict(zip(VECTORS[count], values[:count], strict=True))


def half_pixel(given: Mapping[str, Any]) -> dict[str, Any]:
    """Convert cx and cy of a program that has the centre of the top left pixel at (0.5, 0.5).

    Raises:
        ValueError: there is no centre.
    """
    cx, cy = numbers("cx, cy", [given.get("cx"), given.get("cy")], 2)
    return {**given, "cx": cx - 0.5, "cy": cy - 0.5}


def focal_from_angle(angle: float, side: float) -> float:
    """Focal length in pixels of a pinhole whose image of this side spans an angle in radians."""
    return side / 2 / math.tan(angle / 2)
