"""Cameras as plain values and as files.

A pinhole is `{"model": "pinhole", "size": [h, w], "fx": .., "fy": .., "cx": .., "cy": ..}` in pixels, of
which the top left one has its centre at (0, 0). An omnidirectional camera is `{"model": "omnidirectional",
"size": [h, w], "cx": .., "cy": .., "a0": .., "a1": .., "a2": .., "a3": .., "a4": .., "c": .., "d": ..,
"e": .., "stretch": "[[c, e], [d, 1]]"}`, where `stretch` says how c, d and e fill the stretch matrix; or the
output of a calibration toolbox (see `col3d.geometry.calibration`). Any camera is also the fields of its
class.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import torch

from col3d.checks import DataError, check_known
from col3d.geometry import calibration
from col3d.geometry.calibration import check_rest, checked_size, numbers
from col3d.geometry.camera import Camera, PinholeCamera
from col3d.geometry.omnidirectional import OmnidirectionalCamera

MODELS: dict[str, type[Camera]] = {"pinhole": PinholeCamera, "omnidirectional": OmnidirectionalCamera}
ROUND_TRIP = 1e-3
"""Pixels by which projecting the rays of pixels may miss them."""
PROBED = 9
"""Pixels along either side of an image that are tried."""


def plain_from_camera(camera: Camera) -> dict[str, Any]:
    """Its model and fields, as JSON has them."""
    model = next(name for name, kind in MODELS.items() if type(camera) is kind)
    plain: dict[str, Any] = json.loads(json.dumps({"model": model, **asdict(camera)}))
    return plain


def camera_from_plain(plain: Mapping[str, Any]) -> Camera:
    """The camera of plain values.

    Raises:
        ValueError: says what is missing or not what it should be.
    """
    given = dict(plain)
    kind = MODELS[check_known("model", str(given.pop("model", None)), MODELS)]
    if kind is PinholeCamera and "fx" in given:
        return _pinhole(given)
    if kind is OmnidirectionalCamera and "polynomial" not in given:
        return calibration.from_numbers(given)
    values = {field.name: _field(field.name, given.pop(field.name, None)) for field in fields(kind)}
    check_rest(given)
    (a, b), (c, d) = values["stretch"]
    if a * d == b * c:
        raise ValueError(f"stretch: expected a matrix that can be inverted, got {values['stretch']}")
    return kind(**values)


def read_camera(path: Path) -> Camera:
    """The camera that a file describes.

    Raises:
        DataError: names the file and what is wrong with it.
    """
    try:
        camera = _parsed(path.read_text(encoding="utf-8"))
        _check_round_trip(camera)
    except OSError as error:
        raise DataError(f"{path}: the camera's file cannot be read ({error.strerror})") from None
    except (ValueError, TypeError, AttributeError, RecursionError) as error:
        raise DataError(f"{path}: not a camera: {error}") from None
    return camera


def _parsed(text: str) -> Camera:
    if text.lstrip().startswith(calibration.OCAMCALIB):
        return calibration.from_ocamcalib(text)
    if not text.lstrip().startswith(("{", "[")) and "=" in text:
        return calibration.from_settings(text)
    plain = json.loads(text)
    if not isinstance(plain, dict):
        raise ValueError(f"expected names with values, got a {type(plain).__name__}")
    return calibration.from_matlab(plain) if calibration.MATLAB in plain else camera_from_plain(plain)


def _pinhole(given: dict[str, Any]) -> PinholeCamera:
    size_hw = checked_size(numbers("size", given.pop("size", None), 2))
    names = ("fx", "fy", "cx", "cy")
    fx, fy, cx, cy = numbers(", ".join(names), [given.pop(name, None) for name in names], 4)
    check_rest(given)
    if fx <= 0 or fy <= 0:
        raise ValueError(f"fx, fy: expected numbers above 0, got {fx} and {fy}")
    return PinholeCamera.from_focal(size_hw, fx, fy, cx, cy)


def _field(name: str, value: Any) -> Any:
    """Lists as the tuples that cameras are made of; sizes as whole numbers."""
    counts = {"size_hw": 2, "centre": 2, "polynomial": 5}
    if name in counts:
        found = numbers(name, value, counts[name])
        return checked_size(found) if name == "size_hw" else found
    if name == "stretch":
        rows = value if isinstance(value, list) and len(value) == 2 else [None, None]
        return tuple(numbers(name, row, 2) for row in rows)
    return numbers(name, [value], 1)[0]


def _check_round_trip(camera: Camera) -> None:
    """Refuse a calibration whose rays do not lead back to their pixels, wherever the image is looked at."""
    v, u = (torch.linspace(0, side - 1, PROBED, dtype=torch.float64) for side in camera.size_hw)
    pixels = torch.cartesian_prod(u, v)
    off = (camera.project(camera.unproject(pixels)) - pixels).norm(dim=1).nan_to_num(torch.inf)
    if off.max() > ROUND_TRIP:
        at_u, at_v = (round(place) for place in pixels[off.argmax()].tolist())
        raise ValueError(
            f"expected rays that lead back to their pixels, and that of ({at_u}, {at_v}) misses it; "
            "does the polynomial belong to this size and centre?"
        )
