"""Images, folders, patterns and videos become depth, normals, pictures, clouds and a table."""

import csv
import json
import math
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
import trimesh
from PIL import Image
from refusals import refused
from tiny_run import composed

from col3d.data.datasets.c3vd import C3VD
from col3d.data.datasets.octagon import octagon_mask
from col3d.data.datasets.release import standard_normals
from col3d.data.files.image_files import read_rgb
from col3d.errors import UserError
from col3d.geometry import OmnidirectionalCamera, points_from_depth
from col3d.inference.predict import predict
from col3d.inference.predictor import load_predictor

pytestmark = pytest.mark.filterwarnings("ignore:.*pin_memory.*")
LENS = OmnidirectionalCamera.c3vd().resized((64, 80))


def predicted(checkpoint: Path, source: Path | str, folder: Path, *overrides: str) -> list[dict[str, str]]:
    """The rows of a prediction."""
    place = (f"checkpoint={checkpoint}", f"input={source}", f"output={folder}", "accelerator=cpu")
    predict(composed("predict", *place, *overrides))
    with (folder / "predictions.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def summary(folder: Path) -> dict[str, object]:
    content: dict[str, object] = json.loads((folder / "summary.json").read_text())
    return content


def test_a_video_of_c3vd_is_read_back_as_c3vd(
    tiny_checkpoint: Path, phantom_root: Path, tmp_path: Path
) -> None:
    video = phantom_root / "desc_t4_a"
    rows = predicted(tiny_checkpoint, video, tmp_path / "out", "camera=c3vd", "clouds=2", "batch_size=2")
    assert [(row["name"], row["unit"], row["fault"]) for row in rows] == [
        ("0000", "mm", ""),
        ("0001", "mm", ""),
        ("0002", "mm", ""),
    ]
    assert [bool(row["flicker"]) for row in rows] == [False, True, False]
    copy = tmp_path / "as_c3vd" / "desc_t4_a"
    shutil.copytree(tmp_path / "out" / "frames", copy)
    for path in video.glob("*_color.png"):
        shutil.copy(path, copy)
    frames = C3VD(tmp_path / "as_c3vd", ["desc_t4_a"], release="current", normals="none", camera=LENS)
    item, files = frames[1], frames.kinds["normals"].find(copy)
    normals = standard_normals(read_rgb(files[1], (64, 80), np.uint16), "current")
    network = load_predictor(tiny_checkpoint)
    image = torch.from_numpy(np.array(Image.open(video / "0001_color.png"))).permute(2, 0, 1)
    known = network.predict(image[None], LENS)
    mask = octagon_mask((64, 80))
    assert torch.equal(item["mask"], mask)
    assert torch.allclose(item["depth"][mask], known["depth"][0][mask], atol=100 / 65535)
    assert torch.allclose(normals[:, mask[0]], known["normals"][0][:, mask[0]], atol=1e-4)
    cloud = trimesh.load(tmp_path / "out" / "clouds" / "0000.ply")
    assert len(cloud.vertices) == int(mask.sum())
    assert sorted(path.name for path in (tmp_path / "out" / "clouds").iterdir()) == ["0000.ply", "0002.ply"]
    facts = summary(tmp_path / "out")
    assert (facts["metric"], facts["frames"], facts["skipped"]) == (True, 3, 0)
    capture = cv2.VideoCapture(str(tmp_path / "out" / "side_by_side.mp4"))
    assert capture.get(cv2.CAP_PROP_FRAME_COUNT) == 3


def test_points_lie_on_the_rays_of_the_camera(
    tiny_checkpoint: Path, phantom_root: Path, tmp_path: Path
) -> None:
    image = phantom_root / "desc_t4_a" / "0000_color.png"
    predicted(tiny_checkpoint, image, tmp_path, "camera=[60,61,40,33]", "clouds=1", "files=false")
    cloud = trimesh.load(tmp_path / "clouds" / "0000_color.ply")
    points = np.asarray(cloud.vertices).reshape(64, 80, 3)
    v, u = np.mgrid[:64, :80]
    assert np.allclose(points[..., 0] / points[..., 2], (u - 40) / 60, atol=1e-5)
    assert np.allclose(points[..., 1] / points[..., 2], (v - 33) / 61, atol=1e-5)
    colours = np.asarray(cloud.colors)[:, :3].reshape(64, 80, 3)
    assert np.array_equal(colours, np.asarray(Image.open(image)))
    assert not (tmp_path / "frames").exists()


def test_without_a_camera_no_millimetres_are_claimed(
    tiny_checkpoint: Path, phantom_root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = predicted(tiny_checkpoint, phantom_root / "desc_t4_a" / "0000_color.png", tmp_path)
    assert [row["unit"] for row in rows] == ["relative"]
    facts = summary(tmp_path)
    assert (facts["metric"], facts["camera"]) == (False, None)
    assert "relative" in str(facts["depth_codes"])
    assert "no millimetres are claimed" in capsys.readouterr().out
    with refused(UserError, "clouds", "camera=c3vd"):
        predicted(tiny_checkpoint, phantom_root, tmp_path / "other", "clouds=1")


def test_another_lens_is_said(
    tiny_checkpoint: Path, phantom_root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    image = phantom_root / "desc_t4_a" / "0000_color.png"
    predicted(tiny_checkpoint, image, tmp_path / "a", "camera=c3vd")
    assert "not the lens" not in capsys.readouterr().out
    predicted(tiny_checkpoint, image, tmp_path / "b", "camera=c3vdv2")
    assert "not the lens that col3d_mtl was trained with (phantom)" in capsys.readouterr().out


def test_broken_images_are_reported_and_skipped(
    tiny_checkpoint: Path, phantom_root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    for number in (2, 10):
        shutil.copy(phantom_root / "desc_t4_a" / "0000_color.png", folder / f"shot_{number}.png")
    content = (folder / "shot_2.png").read_bytes()
    (folder / "shot_3.png").write_bytes(content[: len(content) // 2])
    (folder / "shot_4.jpg").write_text("no image")
    Image.fromarray(np.zeros((48, 48, 3), np.uint8)).save(folder / "shot_5.bmp")
    rows = predicted(tiny_checkpoint, folder, tmp_path / "out", "camera=c3vd")
    assert [row["name"] for row in rows] == ["shot_2", "shot_3", "shot_4", "shot_5", "shot_10"]
    assert [bool(row["fault"]) for row in rows] == [False, True, True, True, False]
    for named in ("1080 x 1350", "48 x 48"):
        assert named in rows[3]["fault"]
    assert summary(tmp_path / "out")["skipped"] == 3
    assert capsys.readouterr().out.count("skipped: ") == 3
    assert not (tmp_path / "out" / "side_by_side.mp4").exists()
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad" / "a.png").write_text("no image")
    with refused(UserError, "input", tmp_path / "bad" / "a.png"):
        predicted(tiny_checkpoint, tmp_path / "bad", tmp_path / "nothing")


def test_a_video_file_and_a_pattern(tiny_checkpoint: Path, tmp_path: Path) -> None:
    writer = cv2.VideoWriter(str(tmp_path / "clip.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 12, (96, 64))
    for shade in (40, 90, 140, 190):
        writer.write(np.full((64, 96, 3), shade, np.uint8))
        cv2.imwrite(str(tmp_path / f"still_{shade}.png"), np.full((64, 96, 3), shade, np.uint8))
    writer.release()
    rows = predicted(tiny_checkpoint, tmp_path / "clip.avi", tmp_path / "out")
    assert [row["frame"] for row in rows] == ["0", "1", "2", "3"]
    assert cv2.VideoCapture(str(tmp_path / "out" / "side_by_side.mp4")).get(cv2.CAP_PROP_FPS) == 12
    assert (tmp_path / "out" / "over_time.png").stat().st_size > 1000
    assert not math.isnan(float(str(summary(tmp_path / "out")["flicker_percent"])))
    stills = predicted(
        tiny_checkpoint, f"{tmp_path}/still_*.png", tmp_path / "stills", "video=true", "range=[0,50]"
    )
    assert [row["name"] for row in stills] == ["still_40", "still_90", "still_140", "still_190"]
    assert (tmp_path / "stills" / "side_by_side.mp4").exists()


@pytest.mark.parametrize(
    ("overrides", "about", "named"),
    [
        (["camera=endoscope"], "camera", ("'endoscope'", "c3vd, c3vdv2, simcol3d")),
        (["camera=[1,2]"], "camera", ("[fx,fy,cx,cy]", "[1.0, 2.0]")),
        (["range=[5,5]"], "range", ("[low,high]", "[5.0, 5.0]")),
        (["max_depth=50"], "max_depth", ("published",)),
    ],
)
def test_what_cannot_be_is_refused(
    overrides: list[str],
    about: str,
    named: tuple[str, ...],
    tiny_checkpoint: Path,
    phantom_root: Path,
    tmp_path: Path,
) -> None:
    with refused(UserError, about, *named):
        predicted(tiny_checkpoint, phantom_root / "desc_t4_a", tmp_path / "out", *overrides)
    assert not (tmp_path / "out").exists()


def test_an_earlier_prediction_stays(tiny_checkpoint: Path, phantom_root: Path, tmp_path: Path) -> None:
    image = phantom_root / "desc_t4_a" / "0000_color.png"
    (tmp_path / "mine.txt").write_text("kept")
    predicted(tiny_checkpoint, image, tmp_path)
    with refused(UserError, "output", f"{tmp_path} holds a prediction"):
        predicted(tiny_checkpoint, image, tmp_path)
    predicted(tiny_checkpoint, image, tmp_path, "overwrite=true", "previews=false")
    assert (tmp_path / "mine.txt").read_text() == "kept"
    assert not (tmp_path / "previews").exists()
    with refused(UserError, "input", image.parent / "0000_depth.tiff"):
        predicted(tiny_checkpoint, image.parent / "0000_depth.tiff", tmp_path, "overwrite=true")
    assert (tmp_path / "frames" / "0000_color_depth.tiff").exists()
    with refused(UserError, "input", "no such file", tmp_path / "absent.png"):
        predicted(tiny_checkpoint, tmp_path / "absent.png", tmp_path / "other")


def test_prediction_at_an_image_of_the_networks_size_is_the_networks(tiny_checkpoint: Path) -> None:
    network = load_predictor(tiny_checkpoint)
    images = torch.randint(0, 256, (2, 3, 64, 80), dtype=torch.uint8)
    whole = network.predict(images, LENS)
    with torch.inference_mode():
        own = network.network(images.float() / 255, LENS.rays())
    assert torch.equal(whole["depth"], own["depth"])
    points = points_from_depth(whole["depth"], LENS.rays())
    assert points.shape == (2, 3, 64, 80)
    with refused(ValueError, "camera", "(64, 80)", "(32, 40)"):
        network.predict(images, LENS.resized((32, 40)))


def test_folders_of_others_and_the_input_itself_stay(
    tiny_checkpoint: Path, phantom_root: Path, tmp_path: Path
) -> None:
    (tmp_path / "frames").mkdir()
    mine = tmp_path / "frames" / "mine.png"
    shutil.copy(phantom_root / "desc_t4_a" / "0000_color.png", mine)
    with refused(UserError, "output", f"{tmp_path} holds frames,"):
        predicted(tiny_checkpoint, tmp_path / "frames", tmp_path, "overwrite=true")
    assert mine.exists()
    predicted(tiny_checkpoint, phantom_root / "desc_t4_a", tmp_path / "out", "files=false")
    with refused(UserError, "output", f"{tmp_path / 'out'} holds the input"):
        predicted(tiny_checkpoint, tmp_path / "out" / "side_by_side.mp4", tmp_path / "out", "overwrite=true")


def test_numbers_of_a_pinhole_are_of_the_first_image(tiny_checkpoint: Path, tmp_path: Path) -> None:
    for name, size in (("1.png", (80, 64)), ("2.png", (160, 128)), ("3.png", (80, 80))):
        (tmp_path / "in").mkdir(exist_ok=True)
        Image.new("RGB", size, "red").save(tmp_path / "in" / name)
    rows = predicted(tiny_checkpoint, tmp_path / "in", tmp_path / "out", "camera=[60,60,40,32]", "clouds=1")
    assert [bool(row["fault"]) for row in rows] == [False, False, True]
    assert summary(tmp_path / "out")["camera"]["size_hw"] == [64, 80]  # type: ignore[index]
    small, large = (trimesh.load(tmp_path / "out" / "clouds" / f"{name}.ply").vertices for name in (1, 2))
    corners = [points[0, :2] / points[0, 2] for points in (small, large)]
    assert corners[0] == pytest.approx([-40 / 60, -32 / 60], abs=1e-4)
    assert corners[1] == pytest.approx([-(40.5 - 0.25) / 60, -(32.5 - 0.25) / 60], abs=1e-4)


class Decoded(Exception):
    """A frame was decoded, or a network read."""


def refuse_to_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fail as soon as a frame is decoded or a network is read."""

    def fail(*_: object) -> None:
        raise Decoded

    monkeypatch.setattr("col3d.data.files.images.read_image", fail)
    monkeypatch.setattr("col3d.data.files.video_files.VideoFile.__iter__", fail)
    monkeypatch.setattr("col3d.inference.predict.load_predictor", fail)


@pytest.mark.parametrize("camera", ["c3vd", "simcol3d", "lens.json"])
@pytest.mark.parametrize("kind", ["video", "image", "folder"])
def test_a_lens_of_other_sides_is_refused_before_a_frame_is_decoded(
    camera: str, kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    lens = {"model": "pinhole", "size": [100, 300], "fx": 60.0, "fy": 60.0, "cx": 150.0, "cy": 50.0}
    Path("lens.json").write_text(json.dumps(lens))
    writer = cv2.VideoWriter("clip.avi", cv2.VideoWriter.fourcc(*"MJPG"), 12, (96, 64))
    Path("folder").mkdir()
    for number in range(3):
        picture = np.full((64, 96, 3), 50 * number, np.uint8)
        writer.write(picture)
        cv2.imwrite(f"folder/{number}.png", picture)
    writer.release()
    source = {"video": "clip.avi", "image": "folder/0.png", "folder": "folder"}[kind]
    refuse_to_work(monkeypatch)
    with refused(UserError, "camera", "64 x 96"):
        predicted(tmp_path / "any.ckpt", source, tmp_path / "out", f"camera={camera}")
    with pytest.raises(Decoded):  # a lens that fits is no reason to refuse
        predicted(tmp_path / "any.ckpt", source, tmp_path / "out", "camera=[60,60,48,32]")


def test_a_folder_that_is_taken_is_refused_before_a_network_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((64, 80, 3), np.uint8))
    (tmp_path / "out" / "frames").mkdir(parents=True)
    (tmp_path / "out" / "frames" / "mine.txt").touch()
    refuse_to_work(monkeypatch)
    with refused(UserError, "output", f"{tmp_path / 'out'} holds frames,"):
        predicted(tmp_path / "any.ckpt", tmp_path / "a.png", tmp_path / "out")


def test_a_folder_that_cannot_be_made_is_refused_before_a_network_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((64, 80, 3), np.uint8))
    refuse_to_work(monkeypatch)
    with refused(UserError, "output", tmp_path / "a.png" / "x" / "out", f"{tmp_path / 'a.png'} is a file"):
        predicted(tmp_path / "any.ckpt", tmp_path / "a.png", tmp_path / "a.png" / "x" / "out")
    monkeypatch.setattr("os.access", lambda *_: False)
    with refused(UserError, "output", tmp_path / "out", f"to {tmp_path}"):
        predicted(tmp_path / "any.ckpt", tmp_path / "a.png", tmp_path / "out")


def test_what_is_left_out_is_said(
    tiny_checkpoint: Path, phantom_root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    for name in ("0001.png", "0001_depth.png"):
        shutil.copy(phantom_root / "desc_t4_a" / "0000_color.png", folder / name)
    rows = predicted(tiny_checkpoint, folder, tmp_path / "out")
    assert [row["name"] for row in rows] == ["0001"]
    note = f"note: {folder}: left out, for they are no photos: 1 depth\n"
    assert note in capsys.readouterr().out


def test_every_page_is_predicted_under_a_name_of_its_own(tiny_checkpoint: Path, tmp_path: Path) -> None:
    pages = [Image.new("RGB", (80, 64), (shade, 40, 30)) for shade in (50, 90, 130)]
    pages[0].save(tmp_path / "stack.tif", save_all=True, append_images=pages[1:])
    rows = predicted(tiny_checkpoint, tmp_path / "stack.tif", tmp_path / "out")
    assert [(row["name"], row["fault"]) for row in rows] == [
        ("000000", ""),
        ("000001", ""),
        ("000002", ""),
    ]
    assert len(list((tmp_path / "out" / "frames").glob("*_depth.tiff"))) == 3
