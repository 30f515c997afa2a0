"""The camera that a user names, at the size of the images, and what it sees of them."""

import json
from pathlib import Path
from typing import Any

import pytest
import torch
from refusals import refused

from col3d.data.datasets.octagon import octagon_mask
from col3d.errors import DataError, UserError
from col3d.geometry import FisheyeCamera, PinholeCamera, RadialTangentialCamera
from col3d.inference.cameras import camera_at, lens_of, outside_image, view_of

FISHEYE = {"model": "FISHEYE_OPENCV", "h": 96, "w": 128, "fx": 75.0, "fy": 75.0, "cx": 63.5, "cy": 47.5}
FISHEYE |= {"k1": -0.19, "k2": -0.004, "k3": 0.03, "k4": -0.013}


def written(folder: Path, text: str, name: str = "camera") -> str:
    path = folder / name
    path.write_text(text)
    return str(path)


def test_a_matrix_is_of_the_images_at_hand(tmp_path: Path) -> None:
    lens = lens_of(written(tmp_path, "75.0, 0, 63.0\n0, 76.0, 47.0\n0, 0, 1\n"))
    assert lens is not None
    assert lens.size_hw == (0, 0)
    assert camera_at(lens, (96, 128)) == PinholeCamera.from_focal((96, 128), 75.0, 76.0, 63.0, 47.0)


def test_distortion_without_a_size_is_checked_at_that_of_the_images(tmp_path: Path) -> None:
    vector = {"K": [[75.0, 0, 63.0], [0, 75.0, 47.0], [0, 0, 1]], "D": [-0.12, 0.0, 0.0, 0.0, 0.0]}
    lens = lens_of(written(tmp_path, json.dumps(vector)))
    assert isinstance(lens, RadialTangentialCamera)
    with refused(DataError, "camera", "folds before pixel ("):
        camera_at(lens, (196, 228))
    assert camera_at(lens, (96, 128)).size_hw == (96, 128)


def test_what_a_fisheye_does_not_see_does_not_count(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path, json.dumps(FISHEYE))
    lens = lens_of(path)
    assert isinstance(lens, FisheyeCamera)
    view = view_of(path, (48, 64))
    assert view is not None
    assert torch.equal(view, lens.resized((48, 64)).sees())
    assert view.float().mean() == pytest.approx(0.954, abs=0.005)
    assert not view[0, 0, 0]
    told = capsys.readouterr().out
    assert told.count("of the pixels lie outside the image circle") == 1


def test_what_all_of_an_image_shows_needs_no_mask(tmp_path: Path) -> None:
    plain = {"model": "pinhole", "size": [96, 128], "fx": 75.0, "fy": 75.0, "cx": 63.0, "cy": 47.0}
    assert view_of(written(tmp_path, json.dumps(plain)), (96, 128)) is None
    for option in (None, "none", "simcol3d", [75.0, 75.0, 63.0, 47.0]):
        assert view_of(option, (96, 128)) is None
    octagon = view_of("c3vd", (96, 128))
    assert octagon is not None
    assert torch.equal(octagon, octagon_mask((96, 128)))


def test_a_file_that_changes_is_read_again(tmp_path: Path) -> None:
    path = written(tmp_path, json.dumps(FISHEYE))
    assert isinstance(lens_of(path), FisheyeCamera)
    with refused(UserError, "camera", f"{path}: ", "model: ", "'x'", "polynomial"):
        lens_of(written(tmp_path, json.dumps(FISHEYE | {"model": "x"})))


def test_colmaps_half_pixel_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lens_of(written(tmp_path, "1 PINHOLE 128 96 75 75 63 47\n"))
    assert "0.5 is taken from cx and cy" in capsys.readouterr().out


@pytest.mark.parametrize("centre", [(960.0, 540.0), (-129.0, 47.0), (63.0, 193.0), (1e9, 47.0)])
@pytest.mark.parametrize("kind", ["numbers", "matrix", "file with a size"])
def test_a_principal_point_far_outside_is_refused(
    kind: str, centre: tuple[float, float], tmp_path: Path
) -> None:
    u, v = centre
    plain = {"model": "pinhole", "size": [96, 128], "fx": 75.0, "fy": 75.0, "cx": u, "cy": v}
    options: dict[str, Any] = {
        "numbers": [75.0, 75.0, u, v],
        "matrix": written(tmp_path, f"75 0 {u}\n0 75 {v}\n0 0 1\n"),
        "file with a size": written(tmp_path, json.dumps(plain), "sized.json"),
    }

    with refused((UserError, DataError), "camera", f"({u:.6g}, {v:.6g})", "96 x 128"):
        camera_at(lens_of(options[kind]), (96, 128))


@pytest.mark.parametrize(
    ("centre", "inside"),
    [
        ((63.0, 47.0), True),
        ((-0.5, 95.5), True),
        ((127.5, 0.0), True),
        ((127.6, 0.0), False),
        ((-1.0, 47.0), False),
        ((63.0, 150.0), False),
    ],
)
def test_a_principal_point_outside_is_said(centre: tuple[float, float], inside: bool) -> None:
    camera = camera_at(lens_of([75.0, 75.0, *centre]), (96, 128))
    said = (
        f"the principal point ({centre[0]:.6g}, {centre[1]:.6g}) lies outside of the image of 96 x 128 pixels"
    )
    assert outside_image(camera).startswith(said) != inside
    assert (outside_image(camera) == "") == inside
