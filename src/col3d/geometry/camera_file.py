"""Read and write cameras as plain values and as files.

A pinhole is `{"model": "pinhole", "size": [h, w], "fx": .., "fy": .., "cx": .., "cy": ..}` in pixels, of
which the top left one has its centre at (0, 0); with k1 to k6, p1 and p2 it is one with radial and tangential
distortion, and as `fisheye` with k1 to k4 one of Kannala and Brandt. An omnidirectional camera has cx, cy, a0
to a4, and c, d, e with their `stretch`, "[[c, e], [d, 1]]", which says how they fill the stretch matrix. Any
camera is also the fields of its class. Files of other programs are read as they are: `docs/cameras.md` lists
them.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import torch

from col3d.errors import DataError
from col3d.geometry import calibration
from col3d.geometry.calibration import check_rest, checked_size, numbers
from col3d.geometry.camera import Camera, PinholeCamera
from col3d.geometry.camera_formats import HALF_PIXEL, colmap_fields, fields_of
from col3d.geometry.camera_text import plain_from_text
from col3d.geometry.fisheye import FisheyeCamera
from col3d.geometry.lens_numbers import camera_from_numbers, renamed
from col3d.geometry.omnidirectional import OmnidirectionalCamera
from col3d.geometry.radial_tangential import RadialTangentialCamera

MODELS: dict[str, type[Camera]] = {
    "pinhole": PinholeCamera,
    "radial_tangential": RadialTangentialCamera,
    "fisheye": FisheyeCamera,
    "omnidirectional": OmnidirectionalCamera,
}
OMNIDIRECTIONAL = ("omnidirectional", "scaramuzza", "ocam", "ocamcalib")
ROUND_TRIP = 1e-3
"""Largest distance in pixels between a pixel and the projection of its ray."""
PROBED = 33
"""Number of pixels along either side of an image that are tested."""
MOST_OUTSIDE = 0.5
"""Largest share of a fisheye's image outside its image circle."""
LONGEST = 50_000_000
"""Largest size of a file in bytes: larger ones are no calibrations."""


def plain_from_camera(camera: Camera) -> dict[str, Any]:
    """A camera's model and fields as values for JSON."""
    model = next(name for name, kind in MODELS.items() if type(camera) is kind)
    plain: dict[str, Any] = json.loads(json.dumps({"model": model, **asdict(camera)}))
    return plain


def camera_from_plain(plain: Mapping[str, Any]) -> Camera:
    """Build a camera from plain values.

    Raises:
        ValueError: says what is missing or not what it should be.
    """
    return _with_remark(plain)[0]


def read_camera(path: Path) -> Camera:
    """Read a camera from a file, which has to give the size of the images.

    Raises:
        DataError: names the file and what is wrong with it.
    """
    camera, _ = read_lens(path)
    if camera.size_hw == (0, 0):
        raise DataError(
            f"{path}: not a camera: size: expected the height and width of the images, got nothing; add "
            '"size": [480, 640] to JSON, or lines such as height = 480 and width = 640 to numbers'
        )
    return camera


def read_lens(path: Path) -> tuple[Camera, str]:
    """Read a camera from a file; its size is (0, 0) where the file does not give the size of the images.

    Returns:
        The camera, and a remark on how its numbers were read, or an empty text.

    Raises:
        DataError: names the file and what is wrong with it.
    """
    try:
        camera, remark = _parsed(_text(path))
        check_stretch(camera)
        if camera.size_hw != (0, 0):
            check_round_trip(camera)
    except OSError as error:
        raise DataError(f"{path}: the camera's file cannot be read ({error.strerror})") from None
    except (ValueError, TypeError, AttributeError, ArithmeticError, RecursionError) as error:
        raise DataError(f"{path}: not a camera: {' '.join(str(error).split())}") from None
    return camera, remark


def check_stretch(camera: Camera) -> None:
    """Refuse a camera whose stretch matrix is singular: several of its pixels would be one.

    Raises:
        ValueError: names the matrix that cannot be inverted.
    """
    (a, b), (c, d) = camera.stretch
    if a * d == b * c or not math.isfinite(a * d - b * c):
        raise ValueError(f"stretch: expected a matrix that can be inverted, got {camera.stretch}")


def check_round_trip(camera: Camera) -> None:
    """Refuse a calibration whose rays do not project back to their pixels, anywhere in the image.

    The image of a fisheye may be a circle, outside which pixels have no ray.

    Raises:
        ValueError: names a pixel, or a principal point that is too far outside the image.
    """
    _check_centre(camera)
    v, u = (torch.linspace(0, side - 1, PROBED, dtype=torch.float64) for side in camera.size_hw)
    pixels = torch.cartesian_prod(u, v)
    rays = camera.unproject(pixels)
    off = (camera.project(rays) - pixels).norm(dim=1).nan_to_num(torch.inf)
    outside = rays.isnan().any(dim=1)
    if isinstance(camera, FisheyeCamera) and outside.double().mean() <= MOST_OUTSIDE:
        off[outside] = 0.0
    if off.max() > ROUND_TRIP:
        at_u, at_v = (round(place) for place in pixels[off.argmax()].tolist())
        if outside.any():
            raise ValueError(
                f"the distortion folds before pixel ({at_u}, {at_v}), which has no ray; fit a fisheye (k1 to "
                "k4) or omnidirectional (polynomial a0 to a4) model, if these numbers are of this size"
            )
        raise ValueError(
            f"expected rays that lead back to their pixels, and that of ({at_u}, {at_v}) misses it; "
            "does the polynomial belong to this size and centre?"
        )


def _check_centre(camera: Camera) -> None:
    """Refuse a principal point farther outside than that of any crop of a larger image.

    Raises:
        ValueError: gives its place.
    """
    height, width = camera.size_hw
    u, v = camera.centre
    if not (-width <= u <= 2 * width and -height <= v <= 2 * height):
        raise ValueError(
            f"the principal point ({u:.6g}, {v:.6g}) lies far outside of an image of {height} x {width} "
            "pixels; are these the numbers of another size?"
        )


def _text(path: Path) -> str:
    if path.stat().st_size > LONGEST:
        raise ValueError(f"expected a file of numbers, got {path.stat().st_size / 1e6:.0f} MB")
    try:
        return path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError(
            "expected a text, got a binary file; COLMAP's model_converter, numpy.savetxt and MATLAB's "
            "jsonencode write texts"
        ) from None


def _parsed(text: str) -> tuple[Camera, str]:
    if text.lstrip().startswith(calibration.OCAMCALIB):
        return calibration.from_ocamcalib(text), ""
    if (colmap := colmap_fields(text)) is not None:
        return camera_from_numbers(colmap), HALF_PIXEL
    plain = plain_from_text(text)
    if isinstance(plain, list) and plain and all(isinstance(row, list) for row in plain):
        plain = {"K": plain}
    if not isinstance(plain, dict):
        raise ValueError(f"expected names with values, got a {type(plain).__name__}")
    return _with_remark(plain)


def _with_remark(plain: Mapping[str, Any]) -> tuple[Camera, str]:
    if calibration.MATLAB in plain:
        return calibration.from_matlab(plain), ""
    if "size_hw" in plain:
        return _from_fields(plain), ""
    names = renamed(plain)
    if "a0" in names:
        return _omnidirectional(names), ""
    if str(names.get("model")).lower() in OMNIDIRECTIONAL:
        return calibration.from_numbers({name: names[name] for name in names if name != "model"}), ""
    lens_fields, remark = fields_of(plain)
    return camera_from_numbers(lens_fields), remark


def _omnidirectional(names: dict[str, Any]) -> OmnidirectionalCamera:
    model = names.pop("model", OMNIDIRECTIONAL[0])
    if str(model).lower() not in OMNIDIRECTIONAL:
        raise ValueError(
            f"model: expected omnidirectional, for a0 is of its polynomial, got {str(model)[:60]!r}"
        )
    return calibration.from_numbers(names)


def _from_fields(plain: Mapping[str, Any]) -> Camera:
    """Build a camera from the fields of its class, as `plain_from_camera` writes them."""
    given = dict(plain)
    model = str(given.pop("model", None))
    if model not in MODELS:
        raise ValueError(f"model: {model!r} is unknown; known are {', '.join(MODELS)}")
    kind = MODELS[model]
    values = {field.name: _field(field.name, given.pop(field.name, None)) for field in fields(kind)}
    check_rest(given)
    camera = kind(**values)
    check_stretch(camera)
    return camera


def _field(name: str, value: Any) -> Any:
    """Convert lists to the tuples of cameras' fields, and sizes to integers."""
    counts = {"size_hw": 2, "centre": 2, "polynomial": 5, "distortion": 4, "radial": 6, "tangential": 2}
    if name in counts:
        values = numbers(name, value, counts[name])
        return checked_size(values) if name == "size_hw" else values
    if name == "stretch":
        rows = value if isinstance(value, list) and len(value) == 2 else [None, None]
        return tuple(numbers(name, row, 2) for row in rows)
    return numbers(name, [value], 1)[0]
