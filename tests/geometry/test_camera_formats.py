"""Camera files of other programs: each form is read as its program means it, or refused in one line."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from refusals import refused

from col3d.errors import DataError
from col3d.geometry import Camera, FisheyeCamera, OmnidirectionalCamera, PinholeCamera, RadialTangentialCamera
from col3d.geometry.camera_file import read_camera, read_lens

SIZE = (96, 128)
FOCAL, CENTRE = (75.0, 76.0), (63.0, 47.0)
PINHOLE = PinholeCamera.from_focal(SIZE, *FOCAL, *CENTRE)
K1, K2, K3, K4, K5, K6, P1, P2 = -0.02, 0.03, 0.004, 0.01, -0.002, 0.001, 0.0005, -0.0007
FISHEYE = FisheyeCamera.from_focal(SIZE, FOCAL, CENTRE, (K1, K2, K3, K4))
RADTAN_4 = RadialTangentialCamera.from_focal(SIZE, FOCAL, CENTRE, (K1, K2, 0.0, 0.0, 0.0, 0.0), (P1, P2))
RADTAN_5 = RadialTangentialCamera.from_focal(SIZE, FOCAL, CENTRE, (K1, K2, K3, 0.0, 0.0, 0.0), (P1, P2))
RADTAN_8 = RadialTangentialCamera.from_focal(SIZE, FOCAL, CENTRE, (K1, K2, K3, K4, K5, K6), (P1, P2))
MATRIX = [[75.0, 0.0, 63.0], [0.0, 76.0, 47.0], [0.0, 0.0, 1.0]]
FLAT = {"fx": 75.0, "fy": 76.0, "cx": 63.0, "cy": 47.0}
SIDES = {"width": 128, "height": 96}
SCARAMUZZA = {"cx": 63.0, "cy": 47.0, "a0": 75.0, "a1": 0.0, "a2": -8e-3, "a3": 6e-5, "a4": -1e-6}
OMNIDIRECTIONAL = OmnidirectionalCamera.from_calibration(SIZE, CENTRE, (75.0, 0.0, -8e-3, 6e-5, -1e-6))
STRAIGHT = {"c": 1.0, "d": 0.0, "e": 0.0}


def at_corner(camera: Camera) -> Camera:
    """The same numbers where the corner of the top left pixel, not its centre, is (0, 0)."""
    return camera.cropped(0, 0, *SIZE).__class__(
        **{**camera.__dict__, "centre": (camera.centre[0] - 0.5, camera.centre[1] - 0.5)}
    )


def lines(given: dict[str, Any], mark: str) -> str:
    return "".join(f"{name}{mark}{value}\n" for name, value in given.items())


def storage(ending: str, matrix: Any = MATRIX, **fields: Any) -> str:
    """As OpenCV itself writes it."""
    file = cv2.FileStorage(ending, cv2.FileStorage_WRITE | cv2.FileStorage_MEMORY)
    file.write("calibration_time", "Fri Nov 27")
    file.write("camera_matrix", np.array(matrix))
    for name, value in fields.items():
        file.write(name, np.array([value]) if isinstance(value, list) else value)
    file.write("avg_reprojection_error", 0.31)
    text: str = file.releaseAndGetString()
    return text


def ros(model: str, vector: list[float]) -> str:
    flat = [float(value) for row in MATRIX for value in row]
    return f"""image_width: 128
image_height: 96
camera_name: endoscope
camera_matrix:
  rows: 3
  cols: 3
  data: {flat}
distortion_model: {model}
distortion_coefficients:
  rows: 1
  cols: {len(vector)}
  data: {vector}
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
projection_matrix:
  rows: 3
  cols: 4
  data: [75.0, 0, 63.0, 0, 0, 76.0, 47.0, 0, 0, 0, 1, 0]
"""


def kalibr(distortion: str, vector: list[float], model: str = "pinhole") -> str:
    return f"""cam0:
  camera_model: {model}
  distortion_coeffs: {vector}
  distortion_model: {distortion}
  intrinsics: [75.0, 76.0, 63.0, 47.0]
  resolution: [128, 96]
  rostopic: /endoscope/image_raw
"""


def colmap(line: str) -> str:
    head = "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"
    return f"{head}# Number of cameras: 1\n{line}\n"


def vicalib(kind: str, *values: float) -> str:
    numbers = "; ".join(map(str, values))
    return f"""<rig><camera><camera_model name="" index="0" serialno="0" type="{kind}" version="8">
<width> 128 </width><height> 96 </height><right> [ 1; 0; 0 ] </right>
<params> [ {numbers} ] </params></camera_model></camera></rig>"""


def transforms(**fields: Any) -> str:
    frames = [{"file_path": "a.png", "transform_matrix": np.eye(4).tolist()}]
    return json.dumps(
        {"fl_x": 75.0, "fl_y": 76.0, "cx": 63.0, "cy": 47.0, "w": 128, "h": 96} | fields | {"frames": frames}
    )


KB4 = {"k1": K1, "k2": K2, "k3": K3, "k4": K4}
BROWN = {"k1": K1, "k2": K2, "p1": P1, "p2": P2}
ORDER_5, ORDER_8 = [K1, K2, P1, P2, K3], [K1, K2, P1, P2, K3, K4, K5, K6]
ORB = '%YAML:1.0\n---\nCamera.type: "{}"\nCamera.width: 128\nCamera.height: 96\nCamera.fps: 30\n{}'
READ: dict[str, tuple[str, Camera]] = {
    "C3VD's keys": (json.dumps(SIDES | SCARAMUZZA | STRAIGHT), OMNIDIRECTIONAL),
    "C3VD's keys, upper case": (
        json.dumps({name.upper(): value for name, value in (SIDES | SCARAMUZZA | STRAIGHT).items()}),
        OMNIDIRECTIONAL,
    ),
    "C3VD's keys, lines =": (lines(SIDES | SCARAMUZZA | STRAIGHT, " = "), OMNIDIRECTIONAL),
    "C3VD's keys, lines :": (lines(SIDES | SCARAMUZZA | STRAIGHT, ": "), OMNIDIRECTIONAL),
    "C3VD's keys, upper case lines": (lines(SIDES | SCARAMUZZA, "=").upper(), OMNIDIRECTIONAL),
    "numbers next to nothing": (
        json.dumps({"K": MATRIX, "D": [K1, K2, P1, P2, 1e-320]} | SIDES),
        RadialTangentialCamera.from_focal(SIZE, FOCAL, CENTRE, (K1, K2, 1e-320, 0.0, 0.0, 0.0), (P1, P2)),
    ),
    "C3VD's keys, no a1": (
        json.dumps(SIDES | {n: v for n, v in SCARAMUZZA.items() if n != "a1"}),
        OMNIDIRECTIONAL,
    ),
    "EndoMapper, REIM-NeRF": (
        json.dumps({"model": "FISHEYE_OPENCV", "h": 96, "w": 128} | FLAT | KB4),
        FISHEYE,
    ),
    "fisheye": (json.dumps({"model": "fisheye", "size": [96, 128]} | FLAT | KB4), FISHEYE),
    "OPENCV_FISHEYE": (json.dumps({"camera_model": "OPENCV_FISHEYE"} | SIDES | FLAT | KB4), FISHEYE),
    "equidistant": (
        json.dumps({"distortion_model": "equidistant", "K": MATRIX, "D": list(KB4.values())} | SIDES),
        FISHEYE,
    ),
    "Kannala-Brandt": (lines({"model": "KannalaBrandt8"} | SIDES | FLAT | KB4, " = "), FISHEYE),
    "pinhole": (json.dumps({"model": "pinhole", "size": [96, 128]} | FLAT), PINHOLE),
    "pinhole without a model": (json.dumps(SIDES | FLAT), PINHOLE),
    "pinhole, lines": (lines(SIDES | FLAT, ": "), PINHOLE),
    "pinhole, distortion of zeros": (json.dumps(SIDES | FLAT | {"dist_coeffs": [0, 0, 0, 0]}), PINHOLE),
    "pinhole and k1": (
        json.dumps({"model": "pinhole", "size": [96, 128]} | FLAT | {"k1": -0.1}),
        RadialTangentialCamera.from_focal(SIZE, FOCAL, CENTRE, (-0.1, 0.0, 0.0, 0.0, 0.0, 0.0)),
    ),
    "OpenCV's names": (json.dumps(SIDES | FLAT | BROWN | {"k3": K3}), RADTAN_5),
    "OpenCV's eight names": (
        json.dumps({"model": "opencv"} | SIDES | FLAT | KB4 | BROWN | {"k5": K5, "k6": K6}),
        RADTAN_8,
    ),
    "OpenCV's vector of five": (
        json.dumps({"cameraMatrix": MATRIX, "distCoeffs": ORDER_5} | SIDES),
        RADTAN_5,
    ),
    "OpenCV's vector in a row": (json.dumps({"mtx": MATRIX, "dist": [ORDER_5]} | SIDES), RADTAN_5),
    "OpenCV's vector of eight": (json.dumps({"K": MATRIX, "D": ORDER_8} | SIDES), RADTAN_8),
    "OpenCV's vector of fourteen": (json.dumps({"K": MATRIX, "D": ORDER_8 + [0] * 6} | SIDES), RADTAN_8),
    "OpenCV's vector of four, named": (
        json.dumps({"K": MATRIX, "D": [K1, K2, P1, P2], "model": "radial_tangential"} | SIDES),
        RADTAN_4,
    ),
    **{
        f"OpenCV's storage, {ending}": (
            storage(ending, image_width=128, image_height=96, distortion_coefficients=ORDER_5),
            RADTAN_5,
        )
        for ending in (".yml", ".xml", ".json")
    },
    "OpenCV's storage of a fisheye": (
        storage(
            ".yml",
            image_width=128,
            image_height=96,
            fisheye_model=1,
            distortion_coefficients=list(KB4.values()),
        ),
        FISHEYE,
    ),
    "ROS, plumb_bob": (ros("plumb_bob", ORDER_5), RADTAN_5),
    "ROS, rational": (ros("rational_polynomial", ORDER_8), RADTAN_8),
    "ROS, equidistant": (ros("equidistant", list(KB4.values())), FISHEYE),
    "ROS, a message": (
        f"header: {{frame_id: a}}\nheight: 96\nwidth: 128\ndistortion_model: plumb_bob\nD: {ORDER_5}\n"
        f"K: {[value for row in MATRIX for value in row]}\nR: [1,0,0,0,1,0,0,0,1]\n"
        "P: [75,0,63,0,0,76,47,0,0,0,1,0]\n"
        "binning_x: 0\nbinning_y: 0\nroi: {x_offset: 0, y_offset: 0, height: 0, width: 0}\n---\n",
        RADTAN_5,
    ),
    "Kalibr, radtan": (kalibr("radtan", [K1, K2, P1, P2]), RADTAN_4),
    "Kalibr, equidistant": (kalibr("equidistant", list(KB4.values())), FISHEYE),
    "Kalibr, none": (kalibr("none", []), PINHOLE),
    "ORB-SLAM": (
        ORB.format("PinHole", lines({f"Camera.{n}": v for n, v in (FLAT | BROWN).items()}, ": ")),
        RADTAN_4,
    ),
    "ORB-SLAM, a fisheye": (
        ORB.format("KannalaBrandt8", lines({f"Camera.{n}": v for n, v in (FLAT | KB4).items()}, ": ")),
        FISHEYE,
    ),
    "Vicalib": (vicalib("calibu_fu_fv_u0_v0_kb4", 75, 76, 63, 47, K1, K2, K3, K4), FISHEYE),
    "Vicalib, a pinhole": (vicalib("calibu_fu_fv_u0_v0", 75, 76, 63, 47), PINHOLE),
    "COLMAP, PINHOLE": (colmap("1 PINHOLE 128 96 75 76 63 47"), at_corner(PINHOLE)),
    "COLMAP, commas": ("1,PINHOLE,128,96,75,76,63,47\n", at_corner(PINHOLE)),
    "COLMAP, SIMPLE_PINHOLE": (
        colmap("1 SIMPLE_PINHOLE 128 96 75 63 47"),
        PinholeCamera.from_focal(SIZE, 75.0, 75.0, 62.5, 46.5),
    ),
    "COLMAP, SIMPLE_RADIAL": (
        colmap(f"7 SIMPLE_RADIAL 128 96 75 63 47 {K1}"),
        RadialTangentialCamera.from_focal(SIZE, (75.0, 75.0), (62.5, 46.5), (K1, 0.0, 0.0, 0.0, 0.0, 0.0)),
    ),
    "COLMAP, RADIAL": (
        colmap(f"1 RADIAL 128 96 75 63 47 {K1} {K2}"),
        RadialTangentialCamera.from_focal(SIZE, (75.0, 75.0), (62.5, 46.5), (K1, K2, 0.0, 0.0, 0.0, 0.0)),
    ),
    "COLMAP, OPENCV": (colmap(f"1 OPENCV 128 96 75 76 63 47 {K1} {K2} {P1} {P2}"), at_corner(RADTAN_4)),
    "COLMAP, FULL_OPENCV": (
        colmap(f"1 FULL_OPENCV 128 96 75 76 63 47 {' '.join(map(str, ORDER_8))}"),
        at_corner(RADTAN_8),
    ),
    "COLMAP, OPENCV_FISHEYE": (
        colmap(f"1 OPENCV_FISHEYE 128 96 75 76 63 47 {K1} {K2} {K3} {K4}"),
        at_corner(FISHEYE),
    ),
    "COLMAP, RADIAL_FISHEYE": (
        colmap(f"1 RADIAL_FISHEYE 128 96 75 63 47 {K1} {K2}"),
        FisheyeCamera.from_focal(SIZE, (75.0, 75.0), (62.5, 46.5), (K1, K2, 0.0, 0.0)),
    ),
    "COLMAP, two that are one": (
        colmap("1 PINHOLE 128 96 75 76 63 47\n2 PINHOLE 128 96 75 76 63 47"),
        at_corner(PINHOLE),
    ),
    "nerfstudio, a fisheye": (transforms(camera_model="OPENCV_FISHEYE", **KB4), at_corner(FISHEYE)),
    "nerfstudio, OPENCV": (transforms(camera_model="OPENCV", k3=0.0, k4=0.0, **BROWN), at_corner(RADTAN_4)),
    "nerfstudio, no model": (transforms(), at_corner(PINHOLE)),
    "instant-ngp, a fisheye": (transforms(is_fisheye=True, **KB4), at_corner(FISHEYE)),
    "nerfstudio, in each frame": (
        json.dumps(
            {
                "camera_model": "PINHOLE",
                "frames": [{"fl_x": 75.0, "fl_y": 76.0, "cx": 63.0, "cy": 47.0, "w": 128, "h": 96}] * 2,
            }
        ),
        at_corner(PINHOLE),
    ),
    "Blender's angle": (
        json.dumps({"camera_angle_x": 2 * np.arctan(64 / 75.0), "w": 128, "h": 96, "frames": []}),
        PinholeCamera.from_focal(SIZE, 75.0, 75.0, 63.5, 47.5),
    ),
    "Open3D": (json.dumps({"intrinsic_matrix": np.array(MATRIX).T.ravel().tolist()} | SIDES), PINHOLE),
    "Open3D, with a pose": (
        json.dumps(
            {
                "extrinsic": [1.0],
                "intrinsic": {"intrinsic_matrix": np.array(MATRIX).T.ravel().tolist()} | SIDES,
            }
        ),
        PINHOLE,
    ),
    "RealSense": (
        json.dumps(
            {
                "model": "distortion.brown_conrady",
                "ppx": 63.0,
                "ppy": 47.0,
                "fx": 75.0,
                "fy": 76.0,
                "coeffs": ORDER_5,
            }
            | SIDES
        ),
        RADTAN_5,
    ),
    "MATLAB's pinhole": (
        json.dumps(
            {
                "FocalLength": [75, 76],
                "PrincipalPoint": [64, 48],
                "ImageSize": [96, 128],
                "RadialDistortion": [K1, K2, K3],
                "TangentialDistortion": [P1, P2],
                "Skew": 0,
            }
        ),
        RADTAN_5,
    ),
    "K and its size": (json.dumps({"K": MATRIX, "size": [96, 128]}), PINHOLE),
    "K with skew": (
        json.dumps({"K": [[75.0, 0.4, 63.0], *MATRIX[1:]], "size": [96, 128]}),
        PinholeCamera(SIZE, CENTRE, ((75.0, 0.4), (0.0, 76.0))),
    ),
    "K, text with commas": ("75.0, 0, 63.0\n0, 76.0, 47.0\n0, 0, 1\nheight = 96\nwidth = 128\n", PINHOLE),
    "K, text of NumPy": ("# width = 128\n# height = 96\n7.5e+01 0 63.\n0 76 47\n0 0 1\n", PINHOLE),
    "K, printed by NumPy": (f"{np.array(MATRIX)}\nheight: 96\nwidth: 128", PINHOLE),
    "K, as MATLAB writes it": ("[75 0 63; 0 76 47; 0 0 1]\nheight = 96\nwidth = 128", PINHOLE),
    "K in JSON alone, sides wrapped": (
        json.dumps({"cam_K": MATRIX, "size": SIDES, "depth_scale": 0.1}),
        PINHOLE,
    ),
    "fields in fields": (
        json.dumps({"intrinsics": FLAT, "distortion": BROWN, "resolution": SIDES, "model": "pinhole"}),
        RADTAN_4,
    ),
    "COLMAP's k": (
        json.dumps({"model": "SIMPLE_RADIAL", "f": 75.0, "cx": 63.0, "cy": 47.0, "k": K1} | SIDES),
        RadialTangentialCamera.from_focal(SIZE, (75.0, 75.0), CENTRE, (K1, 0.0, 0.0, 0.0, 0.0, 0.0)),
    ),
    "four numbers": ("75 76 63 47\nheight = 96\nwidth = 128", PINHOLE),
    "K of four rows": (
        "75 0 63 0\n0 76 47 0\n0 0 1 0\n0 0 0 1\nheight: 96\nwidth: 128",
        PINHOLE,
    ),
}


def written(folder: Path, text: str) -> Path:
    path = folder / "camera"
    path.write_text(text)
    return path


@pytest.mark.parametrize("form", READ)
def test_a_form_is_read_as_its_program_means_it(tmp_path: Path, form: str) -> None:
    text, expected = READ[form]
    found = read_camera(written(tmp_path, text))
    assert type(found) is type(expected)
    assert found.size_hw == expected.size_hw
    for name, value in expected.__dict__.items():
        np.testing.assert_allclose(getattr(found, name), value, rtol=1e-12, atol=1e-12, err_msg=name)


@pytest.mark.parametrize("published", [OmnidirectionalCamera.c3vd(), OmnidirectionalCamera.c3vdv2()])
def test_published_numbers_need_no_stretch(tmp_path: Path, published: OmnidirectionalCamera) -> None:
    (c, e), (d, _) = published.stretch
    given = {"width": 1350, "height": 1080, "cx": published.centre[0], "cy": published.centre[1]}
    given |= {f"a{power}": value for power, value in enumerate(published.polynomial)} | {
        "c": c,
        "d": d,
        "e": e,
    }
    found = read_camera(written(tmp_path, json.dumps(given)))
    assert found.stretch == published.stretch
    assert found.centre == published.centre
    with refused(DataError, tmp_path / "camera", ": stretch: "):
        read_camera(written(tmp_path, json.dumps(given | {"d": d + 1e-5})))


FOLDS = {"model": "pinhole"} | SIDES | FLAT | {"k1": -0.3}
REFUSED: dict[str, tuple[str, tuple[str, ...]]] = {
    "distortion that folds": (json.dumps(FOLDS), ("folds before pixel (",)),
    "a fisheye that folds": (
        json.dumps({"model": "fisheye"} | SIDES | FLAT | {"k1": -2.0}),
        ("folds before pixel (",),
    ),
    "no size": (json.dumps(FLAT), (": size: ",)),
    "K without a size": ("75 0 63\n0 76 47\n0 0 1\n", (": size: ",)),
    "K of two rows": ("75 0 63\n0 76 47\n", (": K: ", "got 6")),
    "K and words": ("75 0 63\nseventy\n", ("'seventy'",)),
    "a projection": (
        "75 0 63 9\n0 76 47 0\n0 0 1 0\n0 0 0 1\n",
        (": K: ", "got four"),
    ),
    "no K": (
        json.dumps({"K": [[75, 0, 63], [0, 76, 47], [0, 1, 1]]} | SIDES),
        (": K: ", "[[fx, skew, cx]"),
    ),
    "K and fx": (
        json.dumps({"K": MATRIX} | SIDES | FLAT),
        (": cx, cy, fx, fy: ", "twice", "matrix"),
    ),
    "two names of one": (
        json.dumps({"w": 128} | SIDES | FLAT),
        (": width: ", "twice"),
    ),
    "JSON with one name twice": ('{"fx": 1, "fx": 2}', (": fx: ", "twice")),
    "YAML with one name twice": ("fx: 1\nfx: 2\n", (": fx: ", "twice")),
    "lines with one name twice": ("fx = 1\nfx = 2\n", ("'fx' in section 'camera'",)),
    "an order of sides": (
        json.dumps({"image_size": [128, 96]} | FLAT),
        (": image_size: ", "height and width"),
    ),
    "either family, named": (
        json.dumps(SIDES | FLAT | KB4),
        (": model: ", "pinhole, ", "polynomial", "fisheye or"),
    ),
    "either family, a vector": (
        json.dumps({"K": MATRIX, "D": list(KB4.values())} | SIDES),
        (": model: ", "pinhole, ", "polynomial", "fisheye or"),
    ),
    "both families": (
        json.dumps({"model": "fisheye", "distortion_model": "plumb_bob"} | SIDES | FLAT),
        (": model: ", "fisheye and plumb_bob"),
    ),
    "a fisheye with p1": (
        json.dumps({"model": "fisheye"} | SIDES | FLAT | BROWN),
        (": p1, p2: ", "fisheye", "k1 to k4"),
    ),
    "a fisheye with five": (
        json.dumps({"model": "fisheye", "D": ORDER_5} | SIDES | FLAT),
        (": distortion: ", "four", "fisheye", "got 5"),
    ),
    "a thin prism": (
        json.dumps({"D": [*ORDER_8, 0.1, 0, 0, 0]} | SIDES | FLAT),
        (": distortion: ", "4, 5, 8 ", "got 12", "polynomial"),
    ),
    "three numbers": (
        json.dumps({"D": [K1, K2, K3]} | SIDES | FLAT),
        (": distortion: ", "4, 5, 8 ", "got 3"),
    ),
    "text in a vector": (
        json.dumps({"D": [K1, "x", 0, 0, 0]} | SIDES | FLAT),
        (": distortion: ", "'x'"),
    ),
    "a vector and names": (
        json.dumps({"D": ORDER_5} | SIDES | FLAT | BROWN),
        (": k1, k2, p1, p2: ", "twice"),
    ),
    "no such model": (
        json.dumps({"model": "double_sphere"} | SIDES | FLAT),
        (": model: ", "'double_sphere'", "polynomial"),
    ),
    "no such field": (json.dumps({"zoom": 1.2} | SIDES | FLAT), (": zoom: ",)),
    "fields of another lens": (
        json.dumps({"s1": 0.1, "xi": 1.2} | SIDES | FLAT),
        (": s1, xi: ", "polynomial"),
    ),
    "no focal length": (json.dumps(SIDES | FLAT | {"fx": 0.0}), (": fx, fy: ", "above 0")),
    "numbers that are none": (
        json.dumps(SIDES | FLAT | {"k1": float("nan")}),
        (": k1: ", "finite"),
    ),
    "Kalibr, omni": (
        kalibr("radtan", [0.0] * 4, "omni"),
        (": camera_model: ", "'omni' of Kalibr", "polynomial"),
    ),
    "Kalibr, two": (
        kalibr("none", []) + kalibr("none", []).replace("cam0", "cam1"),
        ("cam0, cam1",),
    ),
    "Kalibr, fov": (kalibr("fov", [0.9]), ("model: ", "'fov'", "polynomial")),
    "COLMAP, another": (
        colmap("1 FOV 128 96 75 76 63 47 0.9"),
        ("model: ", "'FOV' of COLMAP", "polynomial"),
    ),
    "COLMAP, too few": (
        colmap("1 PINHOLE 128 96 75 63 47"),
        ("PINHOLE (fx, fy, cx, cy): ", "expected 4"),
    ),
    "COLMAP, two": (
        colmap("1 PINHOLE 128 96 75 76 63 47\n2 PINHOLE 128 96 75 76 63 48"),
        ("got 2 that differ",),
    ),
    "nerfstudio, two": (
        json.dumps({"frames": [{"fl_x": 75.0, "cx": 63.0}, {"fl_x": 76.0, "cx": 63.0}]}),
        (": frames: ", "got 2 that differ"),
    ),
    "nerfstudio, r^8": (transforms(camera_model="OPENCV", k4=0.1), (": k4: ", "polynomial")),
    "nerfstudio, a panorama": (
        transforms(camera_model="EQUIRECTANGULAR"),
        ("model: ", "'EQUIRECTANGULAR'"),
    ),
    "Blender without sides": (
        json.dumps({"camera_angle_x": 0.7, "frames": []}),
        (": camera_angle_x, w, h: ",),
    ),
    "Vicalib, another": (
        vicalib("calibu_fu_fv_u0_v0_w", 75, 76, 63, 47, 1),
        (": camera_model: ", "'calibu_fu_fv_u0_v0_w'"),
    ),
    "ROS, binned": (
        ros("plumb_bob", ORDER_5) + "binning_x: 2\n",
        (": binning_x: ", "whole images"),
    ),
    "ROS, cut": (
        ros("plumb_bob", ORDER_5) + "roi: {x_offset: 4, y_offset: 0, height: 0, width: 0}\n",
        (": roi: ", "whole images"),
    ),
    "Mei's model in a storage": (
        storage(".yml", image_width=128, image_height=96, xi=1.2),
        (": xi: ", "polynomial"),
    ),
    "two cameras in a storage": (storage(".yml", M1=1.0, M2=2.0), ("got two",)),
    "a stretch that is flat": (
        json.dumps(SIDES | SCARAMUZZA | STRAIGHT | {"c": 0.0}),
        (": stretch: ", "matrix"),
    ),
    "a block of text for a camera": (
        "cam0: |\n  a: 1\n  b: 2\n",
        ("got a: 1 b: 2",),
    ),
    "other XML": ("<svg></svg>", ("<opencv_storage>", "<camera_model>", "0 in <svg>")),
    "XML with entities": ('<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>', ("XML", "declarations")),
    "broken XML": ("<opencv_storage>", ("XML", "read")),
    "YAML with aliases": ("a: &b [1]\nc: *b\n", ("YAML", "aliases")),
    "two documents": ("fx: 1\n---\nfx: 2\n", ("document", "got 2")),
    "prose": ("The camera was calibrated.", ("got a str",)),
    "nothing": ("\n# nothing\n", ("empty",)),
}


@pytest.mark.parametrize("form", REFUSED)
def test_what_is_not_read_is_refused_in_a_line(tmp_path: Path, form: str) -> None:
    text, named = REFUSED[form]
    with refused(DataError, tmp_path / "camera", "not a camera", *named) as caught:
        read_camera(written(tmp_path, text))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"\x93NUMPY\x01\x00", b"\x01\x00\x00\x00\xff\xfe"])
def test_a_binary_file_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "cameras.bin"
    path.write_bytes(content)
    with refused(DataError, path, "binary"):
        read_camera(path)


def test_a_matrix_needs_no_size_where_the_images_have_one(tmp_path: Path) -> None:
    camera, remark = read_lens(written(tmp_path, "75 0 63\n0 76 47\n0 0 1\n"))
    assert camera == PinholeCamera.from_focal((0, 0), 75.0, 76.0, 63.0, 47.0)
    assert remark == ""


def test_what_moves_the_centre_is_said(tmp_path: Path) -> None:
    for form in ("COLMAP, PINHOLE", "nerfstudio, no model", "MATLAB's pinhole"):
        _, remark = read_lens(written(tmp_path, READ[form][0]))
        assert "taken from cx and cy" in remark


def test_an_image_circle_ends_inside_the_image(tmp_path: Path) -> None:
    """Corners that no direction reaches are told apart, and have the rays of the circle's rim."""
    given = {"model": "FISHEYE_OPENCV", **SIDES, "fx": 75.0, "fy": 75.0, "cx": 63.0, "cy": 47.0}
    given |= {"k1": -0.19, "k2": -0.004, "k3": 0.03, "k4": -0.013}
    camera = read_camera(written(tmp_path, json.dumps(given)))
    assert isinstance(camera, FisheyeCamera)
    angles = np.linspace(0, 2, 200001)
    radius = angles * (1 - 0.19 * angles**2 - 0.004 * angles**4 + 0.03 * angles**6 - 0.013 * angles**8)
    first_fold = int(np.argmax(np.diff(radius) < 0))
    assert camera.widest_angle == pytest.approx(angles[first_fold], abs=2e-5)
    v, u = np.mgrid[0:96, 0:128]
    inside = np.hypot(u - 63.0, v - 47.0) <= 75.0 * radius[first_fold]
    np.testing.assert_array_equal(camera.sees()[0].numpy(), inside)
    rays = camera.rays()
    assert bool(rays.isfinite().all())
    rim = np.cos(camera.widest_angle)
    np.testing.assert_allclose(rays[2].numpy()[~inside], rim, atol=2e-3)
    assert bool((rays[0, :, :63][torch.from_numpy(~inside[:, :63])] < 0).all())
