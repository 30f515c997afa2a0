"""What the page makes of what visitors upload, without the page."""

import os
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from PIL import Image
from refusals import refused
from tiny_run import composed

from col3d.errors import DataError, UserError
from col3d.geometry import OmnidirectionalCamera
from col3d.inference.demo.answer import answer
from col3d.inference.demo.checkpoint import newest_checkpoint
from col3d.inference.demo.clips import write_clip
from col3d.inference.demo.points import MOST_POINTS, write_points
from col3d.inference.demo.replies import PINHOLE, UNKNOWN, Question, Reply, reply, scores_table
from col3d.inference.demo.serve import serve
from col3d.inference.demo.uploads import MOST_SIDE, Clip, Truth, read_clip, read_photo, read_truth
from col3d.inference.predictor import Predictor
from col3d.models import create

LENS = OmnidirectionalCamera.c3vd().resized((64, 80))
NO_PINHOLE = (None, None, None, None)


@pytest.fixture(scope="module")
def network() -> Predictor:
    """One that was never trained; it needs rays."""
    made = create("bts", encoder="lcnet_035", width=64, normals="unc", normal_frame="ray").eval()
    return Predictor(made, "bts", (64, 80), 100.0, (LENS,), ("phantom",))


@pytest.fixture(scope="module")
def depth_alone() -> Predictor:
    made = create("bts", encoder="lcnet_035", width=64).eval()
    return Predictor(made, "bts", (64, 80), 100.0, (LENS,), ("phantom",))


def photo(height: int = 96, width: int = 120) -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (height, width, 3), dtype=np.uint8)


def saved(path: Path, pixels: np.ndarray) -> Path:
    Image.fromarray(pixels).save(path)
    return path


def asked(network: Predictor, path: Path, camera: str = "c3vd", truth: Path | None = None) -> Reply:
    question = Question(str(path), truth and str(truth), camera, NO_PINHOLE)
    return reply(network, question, path.parent, lambda _: None)


def claims(path: Path, height: int, width: int) -> Path:
    """A PNG of a few bytes whose header says how large it would be."""
    header = b"IHDR" + width.to_bytes(4) + height.to_bytes(4) + bytes([8, 2, 0, 0, 0])
    path.write_bytes(b"\x89PNG\r\n\x1a\n\0\0\0\r" + header + zlib.crc32(header).to_bytes(4) + b"\0\0\1\0IDAT")
    return path


def test_an_image_becomes_depth_normals_and_points(network: Predictor, tmp_path: Path) -> None:
    found = asked(network, saved(tmp_path / "a.png", photo()))
    assert not found.refused
    assert found.answer is not None
    assert found.answer.known_lens
    assert "<b>a.png</b>, shown at 120 x 96: depth " in found.words
    assert "caution" not in found.words
    low, high = found.answer.span
    assert 0 < low < high < 100
    assert found.answer.normals_picture().shape == (336, 420, 3)
    cloud = trimesh.load(found.cloud)
    assert 0 < len(cloud.vertices) < 96 * 120
    assert (cloud.vertices[:, 2] < 0).all()  # viewers look along -z


def test_another_range_is_another_picture_of_one_prediction(network: Predictor) -> None:
    found = answer(network, photo(), "c3vd")
    pictures = [found.depth_picture(*ends) for ends in ((0.0, 100.0), (0.0, 50.0), (50.0, 0.0))]
    assert (pictures[0] != pictures[1]).any()
    assert (pictures[1] == pictures[2]).all()


def test_without_a_camera_no_millimetres_are_claimed(depth_alone: Predictor, tmp_path: Path) -> None:
    truth = saved(tmp_path / "t.png", np.full((96, 120), 30000, np.uint16))
    found = asked(depth_alone, saved(tmp_path / "a.png", photo()), UNKNOWN, truth)
    assert found.answer is not None
    assert found.answer.unit == "relative"
    assert found.answer.depth.max() == 1
    assert (found.cloud, found.answer.truth) == (None, None)
    assert "no metric claim" in found.words
    assert "left aside" in found.words
    assert "mm" not in found.words.partition("; the true depth, in mm,")[0]


def test_a_lens_of_other_frames_is_told(network: Predictor, tmp_path: Path) -> None:
    assert "caution" in asked(network, saved(tmp_path / "a.png", photo()), "c3vdv2").words


def test_scores_are_those_of_the_truth(network: Predictor) -> None:
    image = photo()
    first = answer(network, image, "c3vd")
    mask = np.zeros((96, 120), bool)
    mask[40:50, 40:60] = True
    found = answer(network, image, "c3vd", Truth(first.depth * np.float32(2), mask))
    scores = found.scores()
    assert scores["AbsRel"] == pytest.approx(0.5, abs=1e-6)
    assert list(scores.values())[2] == 0
    expected = np.sqrt(np.square(first.depth[mask].astype(float)).mean())
    assert scores["RMSE mm"] == pytest.approx(expected, rel=1e-6)
    assert "0.500" in scores_table(scores)
    assert found.error_picture() is not None
    assert first.error_picture() is None


def test_large_images_are_shown_smaller(depth_alone: Predictor, tmp_path: Path) -> None:
    size = (1600, 2000)
    found = answer(depth_alone, np.zeros((*size, 3), np.uint8), "c3vd", Truth(*_flat(size)))
    assert found.depth.shape == (1080, MOST_SIDE)
    assert found.truth.mask.all()
    assert found.camera.size_hw == (1080, MOST_SIDE)
    write_points(found, tmp_path / "cloud.ply")
    assert len(trimesh.load(tmp_path / "cloud.ply").vertices) <= MOST_POINTS


def _flat(size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    return np.full(size, 30, np.float32), np.ones(size, bool)


def test_files_that_are_no_images_are_refused_in_words(network: Predictor, tmp_path: Path) -> None:
    text, cut, large = tmp_path / "<b>.png", tmp_path / "cut.png", tmp_path / "large.tiff"
    text.write_text("no image")
    whole = saved(tmp_path / "whole.png", photo()).read_bytes()
    cut.write_bytes(whole[: len(whole) // 2])
    with large.open("wb") as file:
        file.truncate(51_000_000)
    deep = saved(tmp_path / "deep.png", np.zeros((64, 80), np.uint16))
    for path, words in (
        (text, "&lt;b&gt;.png: not an image that can be read"),
        (cut, "cut.png: the file is cut off; copy it again"),
        (large, "large.tiff: 51 MB; at most 50 MB are taken"),
        (claims(tmp_path / "wide.png", 5000, 6000), "wide.png: 5000 x 6000 pixels are 30 megapixels"),
        (claims(tmp_path / "bomb.png", 50_000, 60_000), "bomb.png: more than 25 megapixels"),
        (deep, "deep.png: expected an image of 8 bits a channel"),
        (saved(tmp_path / "square.png", photo(90, 90)), "camera: the lens is of 1080 x 1350 pixels"),
    ):
        found = asked(network, path)
        assert (found.refused, found.answer) == (True, None)
        assert words in found.words
        assert str(tmp_path) not in found.words


def test_cameras_that_say_nothing_are_refused(network: Predictor, tmp_path: Path) -> None:
    path = saved(tmp_path / "a.png", photo())
    assert "this network needs the camera" in asked(network, path, UNKNOWN).words
    assert "a pinhole needs fx, fy" in asked(network, path, PINHOLE).words
    question = Question(str(path), None, PINHOLE, (100.0, 100.0, 59.5, 47.5))
    assert reply(network, question, tmp_path, print).answer.camera.stretch == ((100, 0), (0, 100))
    nothing = Question(None, None, "c3vd", NO_PINHOLE)
    assert reply(network, nothing, tmp_path, print).words.startswith("Choose an image")


def test_a_true_depth_is_what_c3vd_has(tmp_path: Path) -> None:
    codes = np.array([[0, 65535], [32768, 1]], np.uint16)
    truth = read_truth(saved(tmp_path / "t.tiff", codes), (2, 2))
    assert truth.mask.tolist() == [[False, False], [True, True]]
    assert truth.depth[1, 0] == pytest.approx(50, abs=1e-3)
    cv2.imwrite(str(tmp_path / "rgb.png"), np.dstack([codes] * 3))
    np.save(tmp_path / "a.npy", codes)
    for name in ("rgb.png", "a.npy"):
        assert (read_truth(tmp_path / name, (2, 2)).depth == truth.depth).all()
    np.save(tmp_path / "mm.npy", truth.depth)
    with refused(DataError, "true depth", "mm.npy: ", "16 bits", "float32"):
        read_truth(tmp_path / "mm.npy", (2, 2))
    with refused(DataError, "true depth", "t.tiff: ", "3 x 2", "2 x 2"):
        read_truth(tmp_path / "t.tiff", (3, 2))
    with refused(DataError, "true depth", "b.png: ", "16 bits", "uint8"):
        read_truth(saved(tmp_path / "b.png", codes.astype(np.uint8)), (2, 2))


def video(path: Path, frames: int, fps: float = 10) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), fps, (80, 64))
    for _ in range(frames):
        writer.write(photo(64, 80))
    writer.release()
    return path


def test_a_video_comes_back_side_by_side(network: Predictor, tmp_path: Path) -> None:
    found = asked(network, video(tmp_path / "a.mp4", 3))
    assert "3 frames, depth " in found.words
    capture = cv2.VideoCapture(found.video)
    assert capture.get(cv2.CAP_PROP_FRAME_COUNT) == 3
    assert capture.get(cv2.CAP_PROP_FRAME_WIDTH) > 3 * 80
    told: list[float] = []
    write_clip(network, Clip([photo(64, 80)] * 2, 5.0), "c3vd", tmp_path / "b.mp4", told.append)
    assert told == [0.5, 1.0]


def test_an_animation_is_a_video_and_of_pages_the_first_is_shown(network: Predictor, tmp_path: Path) -> None:
    pages = [Image.new("RGB", (80, 64), (shade, 40, 30)) for shade in (50, 90, 130)]
    for name in ("a.gif", "a.tif"):
        pages[0].save(tmp_path / name, save_all=True, append_images=pages[1:])
    assert "3 frames, depth" in asked(network, tmp_path / "a.gif").words
    assert asked(network, tmp_path / "a.tif").words.endswith("; the first of 3 pictures in it")


def test_long_and_broken_videos_are_refused(network: Predictor, tmp_path: Path) -> None:
    assert "longer than 10 seconds or 150 frames" in asked(network, video(tmp_path / "a.mp4", 101)).words
    (tmp_path / "text.mp4").write_text("no video")
    found = asked(network, tmp_path / "text.mp4")
    assert found.words == "text.mp4: cannot be opened as a video"
    assert len(read_clip(video(tmp_path / "b.mp4", 100), 40).frames) == 100
    assert read_photo(saved(tmp_path / "a.png", photo())).shape == (96, 120, 3)


def test_the_newest_finished_run_is_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert newest_checkpoint(Path("runs")) == Path("shipped")
    for age, name in ((10, "old"), (5, "sweep/new"), (0, "unfinished")):
        folder = Path("runs") / name
        (folder / "checkpoints").mkdir(parents=True)
        (folder / "checkpoints" / "best.ckpt").touch()
        if name != "unfinished":
            (folder / "result.json").touch()
            os.utime(folder / "result.json", (1e9 - age, 1e9 - age))
    assert newest_checkpoint(Path("runs")) == Path("runs/sweep/new/checkpoints/best.ckpt")


@pytest.mark.parametrize(
    ("override", "about", "named"),
    [
        ("port=0", "port", ("equal to 1", 0)),
        ("camera=fisheye", "camera", ("c3vd, c3vdv2, simcol3d", "'fisheye'")),
        ("max_depth=50", "max_depth", ("published",)),
        ("published=bts", "checkpoint", ("published",)),
        ("checkpoint=none.ckpt", "checkpoint", ("no such file: none.ckpt",)),
    ],
)
def test_bad_options_are_refused(override: str, about: str, named: tuple[object, ...]) -> None:
    with refused(UserError, about, *named):
        serve(composed("demo", override))
