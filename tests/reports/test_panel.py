"""Pictures of frames."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from col3d.reports.panel import save_panel


def maps(normals: str) -> dict[str, np.ndarray]:
    generator = np.random.default_rng(0)
    found = {
        "image": generator.random((30, 40, 3)),
        "depth": generator.random((30, 40)) * 50,
        "depth_pred": generator.random((30, 40)) * 50,
        "mask": generator.random((30, 40)) > 0.3,
    }
    if normals != "none":
        found["normals_pred"] = generator.uniform(-1, 1, (30, 40, 3))
    if normals == "both":
        found |= {"normals": generator.uniform(-1, 1, (30, 40, 3)), "angle": generator.random((30, 40)) * 90}
    return found


@pytest.mark.parametrize(("normals", "rows"), [("none", 1), ("predicted", 2), ("both", 2)])
def test_a_panel_is_a_picture_with_its_rows(tmp_path: Path, normals: str, rows: int) -> None:
    save_panel(tmp_path / "panel.png", maps(normals), "cecum_t1_a, frame 3")
    height, width, _ = cv2.imread(str(tmp_path / "panel.png")).shape
    assert width == 1120
    assert height == 240 * rows + 16


def test_the_prediction_is_shown(tmp_path: Path) -> None:
    """Two predictions with the same errors: all but their own picture is the same."""
    pictures = []
    for error in (5.0, -5.0):
        shown = maps("none")
        shown["depth_pred"] = shown["depth"] + error
        save_panel(tmp_path / "panel.png", shown, "title")
        pictures.append(cv2.imread(str(tmp_path / "panel.png")))
    columns = (pictures[0] != pictures[1]).any(axis=(0, 2)).nonzero()[0] / pictures[0].shape[1]
    assert len(columns) > 100
    assert 0.4 < columns.min() < columns.max() < 0.8


@pytest.mark.parametrize("what", ["nothing counts", "prediction is NaN", "constant", "perfect"])
def test_odd_frames_are_drawn(tmp_path: Path, what: str) -> None:
    shown = maps("both")
    if what == "nothing counts":
        shown["mask"][:] = False
    elif what == "prediction is NaN":
        shown["depth_pred"][:] = shown["normals_pred"][:] = shown["angle"][:] = np.nan
    elif what == "constant":
        shown["depth"][:] = shown["depth_pred"][:] = 50.0
    else:
        shown["depth_pred"] = shown["depth"]
    save_panel(tmp_path / "panel.png", shown, "title")
    assert cv2.imread(str(tmp_path / "panel.png")) is not None
