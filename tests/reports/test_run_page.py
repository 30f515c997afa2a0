"""The page of a run: written from its files, and turned in a browser."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fake_runs import DEPTH_METRICS
from PIL import Image
from refusals import refused

from col3d.errors import UserError
from col3d.reports.run_page import write_run_page
from col3d.reports.scenes import read_frame, save_frame

SCORES = dict.fromkeys(DEPTH_METRICS, 0.25)
SUMMARY = {
    "model": "bts <script>alert(1)</script>",
    "data": "phantom",
    "split": "test",
    "split_name": "paper",
    "seed": 3,
    "protocol": "standard",
    "frames": 2,
    "parameters": 1234567,
    "metrics": SCORES,
    "videos": {"desc_t4_a": {"frames": 2, **SCORES}},
    "baseline": dict.fromkeys(DEPTH_METRICS, 0.75),
    "command": "python train.py model=bts",
    "versions": {"torch": "2.14"},
}


def frame_points() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A slanted wall, the same 2 mm off on its right half, and its colours."""
    x, y = (values.ravel() for values in np.meshgrid(np.linspace(-20, 20, 80), np.linspace(-15, 15, 60)))
    truth = np.stack([x, y, 40 + 0.3 * x], axis=1).astype(np.float32)
    prediction = truth + np.where(x[:, None] > 0, [[0, 0, 2.0]], 0).astype(np.float32)
    colours = np.broadcast_to(np.array([200, 90, 80], np.uint8), truth.shape).copy()
    return truth, prediction, colours


@pytest.fixture
def run(tmp_path: Path) -> Path:
    (tmp_path / "panels").mkdir()
    Image.new("RGB", (20, 10), "red").save(tmp_path / "panels" / "desc_t4_a_0001.png")
    save_frame(tmp_path / "panels" / "desc_t4_a_0001.npz", *frame_points())
    (tmp_path / "summary.json").write_text(json.dumps(SUMMARY))
    (tmp_path / "config.yaml").write_text("seed: 3\n")
    (tmp_path / "metrics.csv").write_text("epoch,train/loss,val/loss,val/abs_rel\n0,2,3,0.5\n1,1,2,0.4\n")
    return tmp_path


def test_points_of_a_frame_are_kept_to_the_fiftieth_of_a_millimetre(tmp_path: Path) -> None:
    truth, prediction, colours = frame_points()
    save_frame(tmp_path / "cecum_t1_a_0042.npz", truth, prediction, colours)
    scene = read_frame(tmp_path / "cecum_t1_a_0042.npz")
    assert scene.title == "cecum_t1_a, frame 42"
    assert scene.largest_error == pytest.approx(2.0, abs=0.02)
    for cloud, points in zip(scene.clouds, (truth, prediction), strict=True):
        assert np.abs(cloud.points - points).max() <= 0.0101
        assert np.array_equal(cloud.seen, colours)
    (tmp_path / "other_0001.npz").write_text("no points")
    with refused(ValueError, None, "other_0001"):
        read_frame(tmp_path / "other_0001.npz")


def test_a_run_without_panels_or_curves_has_a_page(tmp_path: Path) -> None:
    (tmp_path / "summary.json").write_text(json.dumps(SUMMARY))
    text = write_run_page(tmp_path).read_text()
    assert "0.250" in text
    assert "Turn a test frame" not in text
    (tmp_path / "summary.json").write_text("{")
    with refused(UserError, None, tmp_path, "finished"):
        write_run_page(tmp_path)


def drawn(browser: Any, place: int) -> np.ndarray:
    """The pixels of a canvas."""
    values = browser.execute_async_script(
        "const canvas = document.querySelectorAll('.panes canvas')[arguments[0]], done = arguments[1];"
        "requestAnimationFrame(() => requestAnimationFrame(() => done(Array.from(canvas.getContext('2d')"
        ".getImageData(0, 0, canvas.width, canvas.height).data))))",
        place,
    )
    return np.array(values, np.uint8).reshape(-1, 4)


def test_the_page_in_a_browser(browser: Any, run: Path) -> None:
    browser.get(write_run_page(run).as_uri())
    assert browser.find_element("tag name", "h1").text.startswith("bts <script>alert(1)</script> on phantom")
    cells = [cell.text for cell in browser.find_elements("css selector", "tbody tr:last-child td")]
    assert cells[1:3] == ["0.750", "0.750"]
    assert len(browser.find_elements("css selector", "#frames img, #training img")) == 2
    truth, prediction = drawn(browser, 0), drawn(browser, 1)
    wall = (truth[:, :3] == [200, 90, 80]).all(axis=1)
    assert 0.05 < wall.mean() < 0.9
    assert (prediction != truth).any()
    browser.find_element("css selector", "input[value=error]").click()
    assert (drawn(browser, 0) == truth).all()
    errors = np.unique(drawn(browser, 1)[:, :3], axis=0)
    assert not (errors == [200, 90, 80]).all(axis=1).any()
    assert "2.0 mm and more" in browser.find_element("class name", "legend").text
    from selenium.webdriver import ActionChains

    canvas = browser.find_elements("css selector", ".panes canvas")[1]
    ActionChains(browser).click_and_hold(canvas).move_by_offset(60, 10).release().perform()
    assert (drawn(browser, 0) != truth).any()
    ActionChains(browser).double_click(canvas).perform()
    assert (drawn(browser, 0) == truth).all()
    said = [
        entry for entry in browser.get_log("browser") if entry["source"] != "rendering"
    ]  # of reading back
    assert said == []
