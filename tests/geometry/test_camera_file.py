"""Cameras as files: what was written comes back, and what is no camera is refused in one line."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from refusals import refused

from col3d.errors import DataError
from col3d.geometry import (
    Camera,
    FisheyeCamera,
    OmnidirectionalCamera,
    PinholeCamera,
    RadialTangentialCamera,
)
from col3d.geometry.camera_file import camera_from_plain, plain_from_camera, read_camera

PIXELS = np.array([[3.0, 5.0], [678.0, 540.0], [1200.0, 30.0], [40.0, 1000.0], [1340.0, 1070.0]])
A0, A2, A3, A4 = 769.243600037458, -0.000812770624150226, 6.25674244578925e-07, -1.19662182144280e-09
C, D, E = 0.99, 0.0028, -0.0029
FLAT = {
    "model": "omnidirectional",
    "size": [1080, 1350],
    "cx": 678.5,
    "cy": 542.9,
    **{"a0": A0, "a2": A2, "a3": A3, "a4": A4},
    **{"c": C, "d": D, "e": E, "stretch": "[[c, e], [d, 1]]"},
}


def without(*names: str) -> dict[str, Any]:
    return {name: value for name, value in FLAT.items() if name not in names}


OCAMCALIB = f"""#polynomial coefficients for the DIRECT mapping function (ocam_model.ss in MATLAB)

5 {-A0:.15e} 0.000000e+00 {-A2:.15e} {-A3:.15e} {-A4:.15e}

#polynomial coefficients for the inverse mapping function (ocam_model.invpol in MATLAB)

3 1.0 2.0 3.0

#center: "row" and "column", starting from 0 (C convention)

542.900000 678.500000

#affine parameters "c", "d", "e"

{C} {D} {E}

#image size: "height" and "width"

1080 1350
"""
PINHOLE = {"model": "pinhole", "size": [48, 64], "fx": 50.0, "fy": 51, "cx": 31.5, "cy": 23.5}


@pytest.mark.parametrize(
    "camera",
    [
        OmnidirectionalCamera.c3vd(),
        OmnidirectionalCamera.c3vdv2().resized((320, 320)).rolled(3.0),
        PinholeCamera.c3vd().cropped(3, 5, 100, 120),
        FisheyeCamera.from_focal((60, 80), (50.0, 51.0), (39.0, 29.0), (0.1, 0.02, 0.0, -0.001)).rolled(7.0),
        RadialTangentialCamera.from_focal(
            (60, 80), (90.0, 91.0), (39.0, 29.0), (0.1, 0.02, 0.0, -0.001, 0.0, 0.002), (0.001, 0.002)
        ).flipped(),
    ],
)
def test_any_camera_comes_back_exactly(camera: Camera) -> None:
    again = camera_from_plain(json.loads(json.dumps(plain_from_camera(camera))))
    assert again == camera
    assert hash(again) == hash(camera)


def test_a_pinhole_is_described_by_its_focal_lengths(tmp_path: Path) -> None:
    path = tmp_path / "camera.json"
    path.write_text(json.dumps(PINHOLE))
    assert read_camera(path) == PinholeCamera.from_focal((48, 64), 50.0, 51.0, 31.5, 23.5)


@pytest.mark.parametrize(
    ("change", "field", "named"),
    [
        ({"model": "fishy"}, "model", ("'fishy'", "pinhole", "polynomial")),
        ({"size": [48]}, "size", ("2 numbers", "[48]")),
        ({"fy": None}, "fx, fy, cx, cy", ("[50.0, None",)),
        ({"k7": 0.1}, "k7", ()),
    ],
)
def test_what_is_no_camera_is_refused(
    tmp_path: Path, change: dict[str, Any], field: str, named: tuple[str, ...]
) -> None:
    path = tmp_path / "camera.json"
    path.write_text(json.dumps(PINHOLE | change))
    with refused(DataError, path, f"not a camera: {field}: ", *named):
        read_camera(path)


def test_a_missing_or_broken_file_is_named(tmp_path: Path) -> None:
    with refused(DataError, tmp_path / "camera.json", "cannot be read"):
        read_camera(tmp_path / "camera.json")
    (tmp_path / "camera.json").write_text("{")
    with refused(DataError, tmp_path / "camera.json", "not a camera"):
        read_camera(tmp_path / "camera.json")


def rays_by_hand(stretch: list[list[float]]) -> np.ndarray:
    x, y = np.linalg.solve(np.array(stretch), (PIXELS - [678.5, 542.9]).T)
    r = np.hypot(x, y)
    rays = np.stack([x, y, A0 + A2 * r**2 + A3 * r**3 + A4 * r**4], axis=1)
    unit: np.ndarray = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    return unit


def cam2world(pixels: np.ndarray) -> np.ndarray:
    """As OCamCalib defines it: x along rows, y along columns, z backwards; in our axes at the end."""
    affine = np.array([[C, D], [E, 1.0]])
    x, y = np.linalg.solve(affine, (pixels[:, ::-1] - [542.9, 678.5]).T)
    r = np.hypot(x, y)
    z = -A0 - A2 * r**2 - A3 * r**3 - A4 * r**4
    rays = np.stack([y, x, -z], axis=1)
    unit: np.ndarray = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    return unit


SETTINGS = "; omnidirectional camera intrinsics\n" + "\n".join(
    f"{name} = {value}"
    for name, value in {"width": 1350, "height": 1080, **FLAT}.items()
    if name not in ("model", "size")
)
MATLAB = json.dumps(
    {
        "MappingCoefficients": [A0, A2, A3, A4],
        "ImageSize": [1080, 1350],
        "DistortionCenter": [679.5, 543.9],
        "StretchMatrix": [[C, D], [E, 1.0]],
    }
)


@pytest.mark.parametrize(
    ("text", "rays"),
    [
        (json.dumps(FLAT), rays_by_hand([[C, E], [D, 1]])),
        (json.dumps(FLAT | {"stretch": "[[c,d],[e,1]]"}), rays_by_hand([[C, D], [E, 1]])),
        (json.dumps(without("c", "d", "e", "stretch")), rays_by_hand([[1, 0], [0, 1]])),
        (SETTINGS, rays_by_hand([[C, E], [D, 1]])),
        (OCAMCALIB, cam2world(PIXELS)),
        (MATLAB, rays_by_hand([[C, D], [E, 1]])),
    ],
    ids=["columns", "rows", "none", "settings", "OCamCalib", "MATLAB"],
)
def test_calibrations_are_read_as_their_programs_mean_them(
    tmp_path: Path, text: str, rays: np.ndarray
) -> None:
    path = tmp_path / "camera"
    path.write_text(text)
    camera = read_camera(path)
    assert camera.size_hw == (1080, 1350)
    np.testing.assert_allclose(camera.unproject(torch.from_numpy(PIXELS)).numpy(), rays, atol=1e-12)


def test_c3vds_lens_is_that_of_its_renderer(tmp_path: Path) -> None:
    numbers = {"cx": 678.544839263292, "cy": 542.975887548343}
    numbers |= {"c": 0.999986882249990, "d": 0.00288273829525059, "e": -0.00296316513429569}
    path = tmp_path / "camera.json"
    path.write_text(json.dumps(FLAT | numbers))
    pixels = torch.from_numpy(PIXELS)
    rays = OmnidirectionalCamera.c3vd().unproject(pixels)
    assert torch.equal(read_camera(path).unproject(pixels), rays)
    path.write_text(json.dumps(FLAT | numbers | {"stretch": "[[c, d], [e, 1]]"}))
    assert not torch.allclose(read_camera(path).unproject(pixels), rays, atol=1e-3)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        (json.dumps(without("stretch")), (": stretch: ", "got nothing")),
        (json.dumps(FLAT | {"stretch": "rows"}), (": stretch: ", "'rows'")),
        (SETTINGS.replace("stretch = [[c, e], [d, 1]]", ""), (": stretch: ", "got nothing")),
        (json.dumps(FLAT | {"a2": 3e-3}), ("rays that lead back",)),
        (json.dumps(FLAT | {"a0": -769.0}), (": a0: ", "above 0")),
        (json.dumps(FLAT | {"k1": 0.1}), (": k1: ",)),
        (json.dumps(FLAT | {"size": [10**9, 1350]}), (": size: ", "from 1 to")),
        (json.dumps(FLAT | {"cx": 10**400}), (": cx, cy: ", "finite")),
        (OCAMCALIB.replace("1080 1350", ""), ("five lines",)),
        (OCAMCALIB.replace("\n5 ", "\n6 "), (": polynomial: ", "1 to 5")),
        (MATLAB.replace("679.5, ", ""), (": DistortionCenter: ", "2 numbers")),
        ("[" * 100_000, ("recursion",)),
        ("[1, 2]", ("got a list",)),
    ],
)
def test_what_is_no_calibration_is_refused(tmp_path: Path, text: str, named: tuple[str, ...]) -> None:
    path = tmp_path / "camera.json"
    path.write_text(text)
    with refused(DataError, path, "not a camera", *named):
        read_camera(path)


def test_a_lens_knows_the_other_readings_of_its_stretch() -> None:
    forms = OmnidirectionalCamera.c3vd().stretch_forms()
    (c, e), (d, _) = OmnidirectionalCamera.c3vd().stretch
    assert {form: camera.stretch for form, camera in forms.items()} == {
        "[[c, e], [d, 1]]": ((c, e), (d, 1)),
        "[[c, d], [e, 1]]": ((c, d), (e, 1)),
        "identity": ((1, 0), (0, 1)),
    }
