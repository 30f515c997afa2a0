"""Cameras as files: what was written comes back, and what is no camera is refused in one line."""

import json
from pathlib import Path
from typing import Any

import pytest

from col3d.checks import DataError
from col3d.geometry import Camera, OmnidirectionalCamera, PinholeCamera
from col3d.geometry.camera_file import camera_from_plain, plain_from_camera, read_camera

PINHOLE = {"model": "pinhole", "size": [48, 64], "fx": 50.0, "fy": 51, "cx": 31.5, "cy": 23.5}


@pytest.mark.parametrize(
    "camera",
    [
        OmnidirectionalCamera.c3vd(),
        OmnidirectionalCamera.c3vdv2().resized((320, 320)).rolled(3.0),
        PinholeCamera.c3vd().cropped(3, 5, 100, 120),
    ],
)
def test_any_camera_comes_back_exactly(camera: Camera) -> None:
    assert camera_from_plain(json.loads(json.dumps(plain_from_camera(camera)))) == camera


def test_a_pinhole_is_described_by_its_focal_lengths(tmp_path: Path) -> None:
    path = tmp_path / "camera.json"
    path.write_text(json.dumps(PINHOLE))
    assert read_camera(path) == PinholeCamera.from_focal((48, 64), 50.0, 51.0, 31.5, 23.5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"model": "fisheye"}, r"model: 'fisheye' is unknown"),
        ({"size": [48]}, r"size: expected 2 numbers, got \[48\]"),
        ({"fy": None}, r"fx, fy, cx, cy: expected numbers, got \[50\.0, None"),
        ({"k1": 0.1}, r"k1: no such field"),
    ],
)
def test_what_is_no_camera_is_refused(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    path = tmp_path / "camera.json"
    path.write_text(json.dumps(PINHOLE | change))
    with pytest.raises(DataError, match=rf"camera\.json: not a camera: {message}"):
        read_camera(path)


def test_a_missing_or_broken_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"camera\.json: the camera's file cannot be read"):
        read_camera(tmp_path / "camera.json")
    (tmp_path / "camera.json").write_text("{")
    with pytest.raises(DataError, match=r"camera\.json: not a camera"):
        read_camera(tmp_path / "camera.json")
