"""Cameras as plain values and as files.

A pinhole is `{"model": "pinhole", "size": [h, w], "fx": .., "fy": .., "cx": .., "cy": ..}` in pixels, of
which the top left one has its centre at (0, 0). Any camera is also the fields of its class: `{"model": ..,
"size_hw": .., "centre": .., "stretch": ..}`, with `polynomial` and `max_radius` if it is `omnidirectional`.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from col3d.checks import DataError, check_known
from col3d.geometry.camera import Camera, OmnidirectionalCamera, PinholeCamera

MODELS: dict[str, type[Camera]] = {"pinhole": PinholeCamera, "omnidirectional": OmnidirectionalCamera}


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
        height, width = _numbers("size", given.pop("size", None), 2)
        names = ("fx", "fy", "cx", "cy")
        fx, fy, cx, cy = _numbers(", ".join(names), [given.pop(name, None) for name in names], 4)
        _check_rest(given)
        if fx <= 0 or fy <= 0:
            raise ValueError(f"fx, fy: expected numbers above 0, got {fx} and {fy}")
        _check_size((height, width))
        return PinholeCamera.from_focal((int(height), int(width)), fx, fy, cx, cy)
    values = {field.name: _frozen(field.name, given.pop(field.name, None)) for field in fields(kind)}
    _check_rest(given)
    _check_size(values["size_hw"])
    (a, b), (c, d) = values["stretch"]
    if a * d == b * c:
        raise ValueError(f"stretch: expected a matrix that can be inverted, got {values['stretch']}")
    return kind(**values)


def _check_size(size_hw: Sequence[int | float]) -> None:
    if not all(side >= 1 and side == int(side) for side in size_hw):
        raise ValueError(f"size: expected whole numbers of pixels from 1 on, got {tuple(size_hw)}")


def read_camera(path: Path) -> Camera:
    """The camera that a JSON file describes.

    Raises:
        DataError: names the file and what is wrong with it.
    """
    try:
        return camera_from_plain(json.loads(path.read_text(encoding="utf-8")))
    except OSError as error:
        raise DataError(f"{path}: the camera's file cannot be read ({error.strerror})") from None
    except (ValueError, TypeError, AttributeError) as error:
        raise DataError(f"{path}: not a camera: {error}") from None


def _frozen(name: str, value: Any) -> Any:
    """Lists as the tuples that cameras are made of; sizes as whole numbers."""
    shapes = {"size_hw": 2, "centre": 2, "polynomial": 5}
    if name in shapes:
        numbers = _numbers(name, value, shapes[name])
        return tuple(int(number) for number in numbers) if name == "size_hw" else numbers
    if name == "stretch":
        rows = value if isinstance(value, list) and len(value) == 2 else [None, None]
        return tuple(_numbers(name, row, 2) for row in rows)
    return _numbers(name, [value], 1)[0]


def _numbers(name: str, values: Any, count: int) -> tuple[float, ...]:
    if not isinstance(values, list) or len(values) != count:
        raise ValueError(f"{name}: expected {count} numbers, got {values!r}")
    if not all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        raise ValueError(f"{name}: expected numbers, got {values!r}")
    if not all(math.isfinite(value) for value in values):
        raise ValueError(f"{name}: expected finite numbers, got {values!r}")
    return tuple(float(value) for value in values)


def _check_rest(given: Mapping[str, Any]) -> None:
    if given:
        raise ValueError(f"{', '.join(given)}: no such field")
