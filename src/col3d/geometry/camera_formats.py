"""Convert camera files of other programs to the fields that `camera_from_numbers` reads."""

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from col3d.geometry.calibration import numbers
from col3d.geometry.camera_text import flattened
from col3d.geometry.lens_numbers import (
    ALIASES,
    HOW_TO,
    NAMES,
    OTHER_LENSES,
    RADIAL,
    TANGENTIAL,
    focal_from_angle,
    half_pixel,
    renamed,
)

COLMAP = {
    "SIMPLE_PINHOLE": ("f", "cx", "cy"),
    "PINHOLE": ("fx", "fy", "cx", "cy"),
    "SIMPLE_RADIAL": ("f", "cx", "cy", "k1"),
    "RADIAL": ("f", "cx", "cy", "k1", "k2"),
    "OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"),
    "FULL_OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    "OPENCV_FISHEYE": ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4"),
    "SIMPLE_RADIAL_FISHEYE": ("f", "cx", "cy", "k1"),
    "RADIAL_FISHEYE": ("f", "cx", "cy", "k1", "k2"),
}
"""Parameters of COLMAP's models in their order."""
VICALIB = {"calibu_fu_fv_u0_v0": "pinhole", "calibu_fu_fv_u0_v0_kb4": "fisheye"}
HALF_PIXEL = "its pixel centres are at halves: 0.5 is taken from cx and cy"
WRAPPERS = ("intrinsic", "intrinsics", "camera", "distortion", "resolution", "size")
"""Fields that may contain those of the lens."""
POSES = ("extrinsic", "extrinsics", "pose")
LENS = {"size", "imagesize", "isfisheye", "fisheyemodel", "skew", *RADIAL, *TANGENTIAL, *ALIASES}


def fields_of(plain: Mapping[str, Any]) -> tuple[dict[str, Any], str]:
    """The fields of a camera file, and a remark on how they were read.

    Raises:
        ValueError: says what is missing or not what it should be.
    """
    if any(re.fullmatch(r"(M|D|camera_matrix_?)[12]", name) for name in plain):
        raise ValueError(f"expected one camera, got two ({', '.join(plain)}); keep that of the images")
    for is_its, read, remark in FORMATS:
        if any(is_its(name) for name in plain):
            return read(plain), remark
    if inner := [
        name for name in WRAPPERS if isinstance(plain.get(name), dict) and "data" not in plain[name]
    ]:
        return fields_of(_unwrapped(plain, inner))
    return (_lens_alone(plain) if _is_storage(plain) else dict(plain)), ""


def _unwrapped(plain: Mapping[str, Any], names: Sequence[str]) -> dict[str, Any]:
    """Fields inside other fields, merged with those outside."""
    fields = {name: value for name, value in plain.items() if name not in (*names, *POSES)}
    for name in names:
        if twice := fields.keys() & plain[name].keys():
            raise ValueError(f"{', '.join(sorted(twice))}: given twice, in {name} as well")
        fields |= plain[name]
    return fields


def colmap_fields(text: str) -> dict[str, Any] | None:
    """The fields of COLMAP's `cameras.txt`; None where the text is no such file.

    Raises:
        ValueError: there are several cameras, or one of an unsupported model.
    """
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    if not lines or not all(re.match(r"\s*\d+[\s,]+[A-Z][A-Z_0-9]+[\s,]+\d+[\s,]", line) for line in lines):
        return None
    cameras = [line.replace(",", " ").split() for line in lines]
    if len({tuple(words[1:]) for words in cameras}) > 1:
        raise ValueError(
            f"expected one camera, got {len(cameras)} that differ; keep the line of that of the images"
        )
    _, model, width, height, *values = cameras[0]
    if model not in COLMAP:
        raise ValueError(f"model: {model!r} of COLMAP is not read; {HOW_TO}")
    names = COLMAP[model]
    parameters = numbers(f"parameters of {model} ({', '.join(names)})", _floats(values), len(names))
    sides = dict(zip(("width", "height"), _floats([width, height]), strict=True))
    return half_pixel({"model": model, **sides, **dict(zip(names, parameters, strict=True))})


def _floats(words: list[str]) -> list[Any]:
    try:
        return [float(word) for word in words]
    except ValueError:
        raise ValueError(f"expected numbers, got {' '.join(words)[:80]!r}") from None


def _is_storage(plain: Mapping[str, Any]) -> bool:
    """Whether matrices have their shape beside them, as in OpenCV's storage and ROS, or ROS prints lists."""
    shaped = [value for value in plain.values() if isinstance(value, dict) and "data" in value]
    return bool(shaped) or ("distortion_model" in plain and {"P", "p", "R", "r"} & plain.keys() != set())


def _lens_alone(plain: Mapping[str, Any]) -> dict[str, Any]:
    """Fields of the lens, in a file with many others; cropped or binned images are refused."""
    for name in ("binning_x", "binning_y"):
        if plain.get(name, 0) not in (0, 1):
            raise ValueError(f"{name}: expected the camera of whole images, got {plain[name]}")
    roi = plain.get("roi")
    if isinstance(roi, dict) and any(roi.get(name) for name in ("x_offset", "y_offset", "height", "width")):
        raise ValueError(f"roi: expected the camera of whole images, got {str(roi)[:80]}")
    names = {name: "".join(letter for letter in name.lower() if letter.isalnum()) for name in plain}
    kept = {name: plain[name] for name, bare in names.items() if NAMES.get(bare, bare) in LENS | OTHER_LENSES}
    return {name: flattened(value) for name, value in kept.items()}


def _kalibr(plain: Mapping[str, Any]) -> dict[str, Any]:
    """Fields of Kalibr's `camchain.yaml`."""
    if len(plain) != 1:
        raise ValueError(f"expected one camera, got {', '.join(plain)}; keep that of the images")
    camera = next(iter(plain.values()))
    if not isinstance(camera, dict):
        raise ValueError(f"expected fields of a camera, got {str(camera)[:80]}")
    if camera.get("camera_model") != "pinhole":
        raise ValueError(f"camera_model: {camera.get('camera_model')!r} of Kalibr is not read; {HOW_TO}")
    width, height = numbers("resolution", camera.get("resolution"), 2)
    return {
        "camera_model": "pinhole",
        "distortion_model": camera.get("distortion_model", "none"),
        "width": width,
        "height": height,
        "intrinsics": list(numbers("intrinsics", camera.get("intrinsics"), 4)),
        "distortion_coeffs": camera.get("distortion_coeffs", []),
    }


def _matlab(plain: Mapping[str, Any]) -> dict[str, Any]:
    """Fields of `jsonencode` of a MATLAB `cameraIntrinsics` or `cameraParameters`."""
    height, width = numbers("ImageSize", plain.get("ImageSize"), 2)
    fx, fy = numbers("FocalLength", plain.get("FocalLength"), 2)
    cx, cy = numbers("PrincipalPoint", plain.get("PrincipalPoint"), 2)
    radial = plain.get("RadialDistortion", [0.0, 0.0])
    count = len(radial) if isinstance(radial, list) and len(radial) in (2, 3) else 2
    distortion = dict(zip(RADIAL[:count], numbers("RadialDistortion", radial, count), strict=True))
    tangential = numbers("TangentialDistortion", plain.get("TangentialDistortion", [0.0, 0.0]), 2)
    distortion |= dict(zip(TANGENTIAL, tangential, strict=True))
    sides: dict[str, Any] = {"model": "pinhole", "height": height, "width": width}
    return {
        **sides,
        "fx": fx,
        "fy": fy,
        "cx": cx - 1,
        "cy": cy - 1,
        "skew": plain.get("Skew", 0.0),
        **distortion,
    }


def _vicalib(plain: Mapping[str, Any]) -> dict[str, Any]:
    kind = str(plain["vicalib"])
    if kind not in VICALIB:
        raise ValueError(f"camera_model: {kind!r} of Vicalib is not read; {HOW_TO}")
    names = ("fx", "fy", "cx", "cy", *(RADIAL[:4] if VICALIB[kind] == "fisheye" else ()))
    values = numbers("params", plain.get("params"), len(names))
    sides = {name: plain.get(name) for name in ("width", "height")}
    return {"model": VICALIB[kind], **sides, **dict(zip(names, values, strict=True))}


def _nerfstudio(plain: Mapping[str, Any]) -> dict[str, Any]:
    """Fields of Nerfstudio's `transforms.json`, at its top or in each frame."""
    wanted = {"w", "h", "fl_x", "fl_y", "cx", "cy", "camera_model", "is_fisheye", *RADIAL, *TANGENTIAL}
    top = {name: value for name, value in plain.items() if name in wanted}
    frames = [frame for frame in plain.get("frames") or [] if isinstance(frame, dict)]
    first = frames[0] if frames else {}
    own = {tuple(sorted((n, str(v)) for n, v in f.items() if n in wanted)) for f in frames}
    if len(own) > 1:
        raise ValueError(f"frames: expected one camera for all, got {len(own)} that differ")
    fields = {**top, **{name: value for name, value in first.items() if name in wanted}}
    if "fl_x" not in fields and "camera_angle_x" in plain:
        fields |= _of_angles(plain, fields)
    fields.setdefault("fl_y", fields.get("fl_x"))
    fields.setdefault("camera_model", "OPENCV_FISHEYE" if fields.pop("is_fisheye", False) else "OPENCV")
    fields.pop("is_fisheye", None)
    if fields["camera_model"] in ("OPENCV", "RADIAL", "SIMPLE_RADIAL") and fields.pop("k4", 0):
        raise ValueError(f"k4: the eighth power of a pinhole's distortion is not read; {HOW_TO}")
    return renamed(fields)


def _of_angles(plain: Mapping[str, Any], fields: Mapping[str, Any]) -> dict[str, float]:
    """Focal lengths and the image's middle from fields of view in radians, as for rendered images."""
    across, width, height = numbers(
        "camera_angle_x, w, h", [plain["camera_angle_x"], fields.get("w"), fields.get("h")], 3
    )
    fx = focal_from_angle(across, width)
    down = plain.get("camera_angle_y")
    fy = fx if down is None else focal_from_angle(numbers("camera_angle_y", [down], 1)[0], height)
    return {"fl_x": fx, "fl_y": fy, "cx": fields.get("cx", width / 2), "cy": fields.get("cy", height / 2)}


def _prefixed(plain: Mapping[str, Any]) -> dict[str, Any]:
    """Fields of ORB-SLAM's settings, `Camera.fx` and so on."""
    return _lens_alone({name.split(".", 1)[1]: value for name, value in plain.items() if _is_prefixed(name)})


def _is_prefixed(name: str) -> bool:
    return re.fullmatch(r"Camera\d*\.\w+", name) is not None


FORMATS: tuple[tuple[Callable[[str], bool], Callable[[Mapping[str, Any]], dict[str, Any]], str], ...] = (
    (lambda name: name == "vicalib", _vicalib, ""),
    (lambda name: re.fullmatch(r"cam\d+", name) is not None, _kalibr, ""),
    (
        lambda name: name == "PrincipalPoint",
        _matlab,
        "MATLAB counts pixels from 1: 1 is taken from cx and cy",
    ),
    (_is_prefixed, _prefixed, ""),
    (
        lambda name: name in ("frames", "fl_x", "camera_angle_x"),
        lambda plain: half_pixel(_nerfstudio(plain)),
        HALF_PIXEL,
    ),
)
"""Test of a name that identifies a program's file, reader of the file, and remark on how it was read."""
