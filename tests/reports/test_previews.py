"""Pictures of depth and normals, beside one another and as a video."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from col3d.reports.previews import (
    GREY,
    TITLE,
    SideBySide,
    colours,
    depth_picture,
    normals_picture,
    with_colour_bar,
)
from col3d.reports.video import VideoWriter


def test_depth_has_the_ends_of_the_scale_beyond_its_span() -> None:
    depth = np.array([[0.0, 10.0, 15.0, 20.0, 90.0]], np.float32)
    picture = depth_picture(depth, 10.0, 20.0, np.array([[True, True, True, True, False]]))
    scale = colours("viridis")
    assert picture[0].tolist() == [*(scale[i].tolist() for i in (0, 0, 127, 255)), [GREY] * 3]


def test_a_wall_that_faces_the_camera_is_blue() -> None:
    assert normals_picture(np.array([[[0.0, 0.0, -1.0]]], np.float32)).tolist() == [[[127, 127, 255]]]


def test_a_page_holds_its_pictures_and_has_even_sides() -> None:
    page = SideBySide(("one", "two"), (21, 31), 0.0, 50.0, "mm")
    shades = [np.full((21, 31, 3), shade, np.uint8) for shade in (30, 200)]
    drawn = page(shades)
    assert (drawn.shape[0] % 2, drawn.shape[1] % 2) == (0, 0)
    assert (drawn[TITLE : TITLE + 21, :31] == 30).all()
    assert (drawn[TITLE : TITLE + 21, 39:70] == 200).all()
    larger = page([np.full((42, 62, 3), shade, np.uint8) for shade in (30, 200)])
    assert (larger == drawn).all()
    barred = with_colour_bar(shades[0], 0.0, 50.0, "mm")
    bar = barred[TITLE : TITLE + 21, 39:55]
    assert (bar[0] == colours("viridis")[255]).all()
    assert (bar[-1] == colours("viridis")[0]).all()


def test_a_video_is_read_back(tmp_path: Path) -> None:
    writer = VideoWriter(tmp_path / "a.mp4", 10.0)
    for shade in (20, 120, 220):
        writer.add(np.full((64, 96, 3), (shade, 40, 60), np.uint8))
    assert not (tmp_path / "a.mp4").exists()
    writer.close()
    capture = cv2.VideoCapture(str(tmp_path / "a.mp4"))
    reds = []
    while (read := capture.read())[0]:
        reds.append(int(read[1][32, 48, 2]))
    assert reds == pytest.approx([20, 120, 220], abs=6)
    assert [path.name for path in tmp_path.iterdir()] == ["a.mp4"]
    VideoWriter(tmp_path / "empty.mp4", 10.0).close()
    assert not (tmp_path / "empty.mp4").exists()
