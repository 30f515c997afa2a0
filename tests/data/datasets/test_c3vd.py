"""Reading C3VD: both releases, what does not count, and every bad input as one error that names the file."""

import os
import warnings
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from pydantic import ValidationError
from refusals import refused
from torch.utils.data import default_collate

from col3d.batch import Batch
from col3d.data.datasets.c3vd import C3VD
from col3d.data.datasets.octagon import octagon_mask
from col3d.data.datasets.release import camera_to_world, disagreement, standard_normals
from col3d.data.files.image_files import read_grey, read_rgb
from col3d.errors import DataError, OptionError
from col3d.geometry import OmnidirectionalCamera, PinholeCamera, angle_between
from col3d.registry import DATASETS

SAMPLE = os.environ.get("COL3D_C3VD_SAMPLE")
needs_sample = pytest.mark.skipif(SAMPLE is None, reason="COL3D_C3VD_SAMPLE names no folder of real frames")


@pytest.mark.parametrize("release", ["current", "pre_2023_05"])
@pytest.mark.parametrize("asked", ["auto", "same"])
def test_both_releases_give_the_standard_normals(write_video, look, lens, release: str, asked: str) -> None:
    root = write_video(release=release)
    frames = C3VD(root, ["cecum_t1_a"], release=release if asked == "same" else "auto", camera=lens)
    assert frames.releases == {"cecum_t1_a": release}
    depth, normals, mask = look("tube", lens.rays())
    item = frames[1]
    inside = octagon_mask((108, 135)) & mask[0]
    assert torch.equal(item["mask"], inside)
    np.testing.assert_allclose(item["depth"][inside], depth[0][inside], atol=1e-3)
    angles = angle_between(item["normals"].double(), normals[0])[inside]
    assert angles.max() < (0.01 if release == "current" else 0.5)  # old ones that look away lost their z
    assert angles.median() < 0.005
    assert (item["normals"] * item["rays"]).sum(dim=0)[inside[0]].max() < 0


def test_old_normals_that_look_away_get_their_z_back(write_video, look, lens) -> None:
    _, normals, mask = look("tube", lens.rays())
    away = (normals[0, 2:] > 0.05) & mask[0] & octagon_mask((108, 135))
    assert away.sum() > 100
    item = C3VD(write_video(release="pre_2023_05"), ["cecum_t1_a"], camera=lens)[0]
    assert (item["normals"][2:][away] > 0).all()


@pytest.mark.parametrize(("release", "other"), [("current", "pre_2023_05"), ("pre_2023_05", "current")])
def test_the_wrong_release_is_refused(write_video, lens, release: str, other: str) -> None:
    with refused(DataError, None, "_normals.tiff: ", f"data.release={other}", "current", "pre_2023_05"):
        C3VD(write_video(release=release), ["cecum_t1_a"], release=other, camera=lens)


def test_release_is_told_by_normals_and_not_by_names(write_video, lens) -> None:
    root = write_video(release="pre_2023_05", stored="current")
    assert C3VD(root, ["cecum_t1_a"], camera=lens).releases == {"cecum_t1_a": "current"}


def test_normals_of_another_scene_are_refused(write_video, look, lens) -> None:
    root = write_video()
    noise = np.random.default_rng(0).integers(1, 65535, (108, 135, 3), dtype=np.uint16)
    for path in root.glob("*/*_normals.tiff"):
        cv2.imwrite(str(path), noise)
    with refused(DataError, root / "cecum_t1_a" / "0001_normals.tiff", "data.release=auto"):
        C3VD(root, ["cecum_t1_a"], camera=lens)


def test_item_is_a_batch_without_its_axis(write_video, lens) -> None:
    item = C3VD(write_video(), ["cecum_t1_a"], camera=lens)[2]
    assert set(item) == set(Batch.__annotations__)
    expected = {"image": 3, "depth": 1, "normals": 3, "rays": 3}
    for key, channels in expected.items():
        assert item[key].shape == (channels, 108, 135), key
        assert item[key].dtype == torch.float32, key
    assert item["mask"].shape == (1, 108, 135)
    assert item["mask"].dtype == torch.bool
    assert (item["video"], item["frame"]) == ("cecum_t1_a", 2)
    assert (item["image"][0] == 2 / 255).all()  # RGB, not BGR
    assert (item["image"][1] == 200 / 255).all()
    assert (item["depth"][~item["mask"]] == 0).all()
    assert (item["normals"][~item["mask"].expand(3, -1, -1)] == 0).all()
    torch.testing.assert_close(
        item["normals"].norm(dim=0)[item["mask"][0]], torch.ones(int(item["mask"].sum()))
    )
    assert default_collate([item, item])["depth"].shape == (2, 1, 108, 135)


def test_order_is_by_number(write_video, lens) -> None:
    root = write_video(numbers=(10, 9, 2, 100), release="pre_2023_05")
    frames = C3VD(root, ["cecum_t1_a"], camera=lens)
    assert [frame.number for frame in frames.frames] == [2, 9, 10, 100]
    assert [round(frames[i]["image"][0, 0, 0].item() * 255) for i in range(4)] == [2, 9, 10, 100]


def test_unpadded_colour_beside_padded_depth(write_video, lens) -> None:
    root = write_video(numbers=(2, 9, 10))
    for path in root.glob("*/*_color.png"):
        path.rename(path.with_name(f"{int(path.name[:4])}_color.png"))
    (root / "cecum_t1_a" / "0002_flow.tiff").touch()
    frames = C3VD(root, ["cecum_t1_a"], normals="derived", camera=lens)
    assert [frames[i]["frame"] for i in range(3)] == [2, 9, 10]
    assert frames.releases == {"cecum_t1_a": "current"}


@pytest.mark.parametrize("code", [0, 65535])
def test_both_ends_of_the_code_are_invalid(write_video, lens, code: int) -> None:
    root = write_video(numbers=(0,))
    path = root / "cecum_t1_a" / "0000_depth.tiff"
    codes = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    codes[40:60, 50:70] = code
    codes[60, 50:53] = (1, 65534, 32768)
    cv2.imwrite(str(path), codes)
    item = C3VD(root, ["cecum_t1_a"], normals="none", camera=lens)[0]
    assert not item["mask"][:, 40:60, 50:70].any()
    assert (item["depth"][:, 40:60, 50:70] == 0).all()
    np.testing.assert_allclose(
        item["depth"][0, 60, 50:53], np.array([1, 65534, 32768]) / 65535 * 100, rtol=1e-6
    )
    assert item["mask"][0, 60, 50:53].all()


def test_pixels_without_a_stored_normal_count_for_depth_alone(write_video, lens) -> None:
    root = write_video(numbers=(0,))
    path = root / "cecum_t1_a" / "0000_normals.tiff"
    codes = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    codes[40:60, 50:70] = 0
    cv2.imwrite(str(path), codes)
    item = C3VD(root, ["cecum_t1_a"], camera=lens)[0]
    assert item["mask"][:, 40:60, 50:70].all()
    assert not item["normals"][:, 40:60, 50:70].any()
    assert C3VD(root, ["cecum_t1_a"], normals="none", camera=lens)[0]["mask"][:, 40:60, 50:70].all()


def test_derived_normals(write_video, look, lens) -> None:
    root = write_video()
    for path in root.glob("*/*_normals.tiff"):
        path.unlink()
    item = C3VD(root, ["cecum_t1_a"], normals="derived", camera=lens)[0]
    angles = angle_between(item["normals"].double(), look("tube", lens.rays())[1][0])[item["mask"]]
    assert item["mask"].float().mean() > 0.8
    assert angles.median() < 0.1
    assert "normals" not in C3VD(root, ["cecum_t1_a"], normals="none", camera=lens)[0]
    with refused(DataError, root / "cecum_t1_a", "frame 0 ", "0000_normals.tiff", "data.normals=derived"):
        C3VD(root, ["cecum_t1_a"], camera=lens)


def test_ranges_and_labels_and_several_videos(write_video, lens) -> None:
    write_video("cecum_t1_a", (0, 1, 2, 3, 4))
    root = write_video("trans_t4_a", (0, 1), release="pre_2023_05")
    frames = C3VD(root, ["c1v1:1-3", "t3v1"], camera=lens)
    found = [(frame.video, frame.number) for frame in frames.frames]
    assert found == [*(("cecum_t1_a", n) for n in (1, 2, 3)), ("trans_t4_a", 0), ("trans_t4_a", 1)]
    assert frames.releases == {"cecum_t1_a": "current", "trans_t4_a": "pre_2023_05"}
    with refused(DataError, root / "cecum_t1_a", "no frames"):
        C3VD(root, ["cecum_t1_a:7-9"], camera=lens)


# poses


@pytest.mark.parametrize("release", ["current", "pre_2023_05"])
def test_poses_act_on_columns(write_video, lens, release: str) -> None:
    root = write_video(release=release, numbers=range(5))
    found = C3VD(root, ["cecum_t1_a"], camera=lens).poses("cecum_t1_a")
    assert found.dtype == torch.float64
    angles = np.linspace(0, 1, 5)
    expected = np.stack([angles * 10 + 1, angles - 5, angles + 7], axis=1)
    np.testing.assert_allclose(found[:, :3, 3], expected)
    np.testing.assert_allclose(found[:, 1, 0], np.sin(angles), atol=1e-12)
    np.testing.assert_allclose(found[:, 3], np.tile([0, 0, 0, 1.0], (5, 1)))


@pytest.mark.parametrize(
    "text",
    [
        "",
        "1,2,3\n",
        "1,0,0\n1,0\n",
        "a,b\n",
        "\x00\x01\n",
        ",".join(["1"] * 16),
        "1 0 0 0\n" * 4,
        ",".join("0" * 15),
    ],
)
def test_a_malformed_pose_file_is_named(write_video, lens, text: str) -> None:
    root = write_video()
    (root / "cecum_t1_a" / "pose.txt").write_text(text)
    with refused(DataError, root / "cecum_t1_a" / "pose.txt", "lines of 16"):
        C3VD(root, ["cecum_t1_a"], camera=lens).poses("cecum_t1_a")


def test_lines_that_split_a_matrix_are_refused(write_video, lens) -> None:
    root = write_video()
    (root / "cecum_t1_a" / "pose.txt").write_text("1,0,0,0,0,1,0,0\n0,0,1,0,5,6,7,1\n")
    with refused(DataError, root / "cecum_t1_a" / "pose.txt", "lines of 16"):
        C3VD(root, ["cecum_t1_a"], camera=lens).poses("cecum_t1_a")


def test_a_missing_pose_file_is_named(write_video, lens) -> None:
    root = write_video()
    (root / "cecum_t1_a" / "pose.txt").unlink()
    with refused(DataError, root / "cecum_t1_a" / "pose.txt"):
        C3VD(root, ["cecum_t1_a"], camera=lens).poses("cecum_t1_a")


def test_no_pose_is_one_without_its_last_row() -> None:
    with refused(ValueError, None, "row", "column", "(0, 0, 0, 1)"):
        camera_to_world(np.ones((2, 16)))


# bad input: every one a DataError that names the file; what a single file can be, see test_files.py


@pytest.mark.parametrize(("kind", "needed"), [("depth.tiff", True), ("normals.tiff", False)])
def test_only_files_that_are_read_are_checked(write_video, lens, kind: str, needed: bool) -> None:
    root = write_video()
    (root / "cecum_t1_a" / f"0001_{kind}").write_bytes(b"junk")
    if needed:
        with refused(DataError, root / "cecum_t1_a" / "0001_depth.tiff", "readable"):
            C3VD(root, ["cecum_t1_a"], normals="none", camera=lens)
    else:
        assert len(C3VD(root, ["cecum_t1_a"], normals="none", camera=lens)) == 3


def test_two_files_of_one_frame_are_refused(write_video, lens) -> None:
    root = write_video("cecum_t1_a")
    (root / "cecum_t1_a" / "1_color.png").write_bytes((root / "cecum_t1_a" / "0001_color.png").read_bytes())
    with refused(DataError, root / "cecum_t1_a" / "1_color.png", " 0001_color.png"):
        C3VD(root, ["cecum_t1_a"], camera=lens)


def test_missing_and_unknown_folders(write_video, lens, tmp_path: Path) -> None:
    with refused(DataError, f"data.root={tmp_path / 'nowhere'}"):
        C3VD(tmp_path / "nowhere", ["cecum_t1_a"], camera=lens)
    root = write_video()
    (root / ".partial-sigmoid").mkdir()
    (root / "readme.txt").touch()
    assert list(C3VD.video_folders(root)) == ["cecum_t1_a"]
    with refused(DataError, None, "video 'cecum_t1_aa'", "'cecum_t1_a'"):
        C3VD(root, ["cecum_t1_aa"], camera=lens)
    with refused(DataError, root / "desc_t4_a", "no such video"):
        C3VD(root, ["desc_t4_a"], camera=lens)
    (root / "desc_t4_a").mkdir()
    with refused(DataError, root / "desc_t4_a", "no frames"):
        C3VD(root, ["desc_t4_a"], camera=lens)


def test_a_name_that_is_not_utf8_is_refused(tmp_path: Path) -> None:
    (tmp_path / os.fsdecode(b"clip\xff")).mkdir()
    with refused(DataError, repr(os.fsdecode(b"clip\xff")), "UTF-8"):
        C3VD(tmp_path, ["cecum_t1_a"])


def test_folders_are_looked_for_once(write_video, lens, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Path] = []
    of_root = C3VD.video_folders
    monkeypatch.setattr(
        C3VD, "video_folders", staticmethod(lambda root: (asked.append(root), of_root(root))[1])
    )
    write_video("cecum_t1_a")
    root = write_video("trans_t4_a")
    frames = C3VD(root, ["cecum_t1_a:0-0", "cecum_t1_a:1-2", "trans_t4_a"], camera=lens)
    assert list(frames.folders) == ["cecum_t1_a", "trans_t4_a"]
    assert asked == [root]


def test_unknown_options(write_video, lens) -> None:
    with refused(OptionError, "data.normals", "'store'", "'stored'"):
        C3VD(write_video(), ["cecum_t1_a"], camera=lens, normals="store")
    with refused(ValidationError, None, "release", "'auto', 'current' or 'pre_2023_05'"):
        DATASETS["c3vd"].options().model_validate({"release": "curent"})


def test_a_frame_without_any_depth_does_not_decide_the_release(write_video, lens) -> None:
    root = write_video(release="pre_2023_05", numbers=range(3))
    cv2.imwrite(str(root / "cecum_t1_a" / "1_depth.tiff"), np.full((108, 135), 65535, np.uint16))
    assert C3VD(root, ["cecum_t1_a"], camera=lens).releases == {"cecum_t1_a": "pre_2023_05"}


# real frames


def sample() -> Path:
    assert SAMPLE is not None
    return Path(SAMPLE)


@needs_sample
def test_octagon_is_that_of_the_frames() -> None:
    mask = read_grey(sample() / "corner_mask.png", (1080, 1350), np.uint8) > 0
    assert (octagon_mask()[0].numpy() == mask).mean() > 0.999


@needs_sample
@pytest.mark.parametrize(
    ("folder", "release", "padded"),
    [("sample_current", "current", "0000"), ("sample_pre_2023_05", "pre_2023_05", "0")],
)
def test_real_normals_are_those_of_their_depth(folder: str, release: str, padded: str) -> None:
    path = sample() / folder / "unknown_frame"
    codes = read_rgb(path / f"{padded}_normals.tiff", (1080, 1350), np.uint16)
    depth_codes = read_grey(path / f"{padded}_depth.tiff", (1080, 1350), np.uint16)
    mask = torch.from_numpy((depth_codes > 0) & (depth_codes < 65535))[None] & octagon_mask()
    depth = torch.from_numpy(depth_codes.astype(np.float32) / 65535 * 100)[None]
    angles = disagreement(codes, depth, mask, OmnidirectionalCamera.c3vd())
    other = next(name for name in angles if name != release)
    pinhole = disagreement(codes, depth, mask, PinholeCamera.c3vd())[release]
    print(
        f"\n{folder}: true lens {angles[release]:.2f} degrees, pinhole {pinhole:.2f}, "
        f"true lens read as {other} {angles[other]:.1f}"
    )
    assert angles[release] < 2.5
    assert angles[other] > 25
    assert pinhole > 10
    frames = C3VD(sample() / folder, ["unknown_frame"])
    assert frames.releases == {"unknown_frame": release}
    assert frames[0]["mask"].float().mean() > 0.8


@needs_sample
def test_real_frames_with_derived_normals() -> None:
    frames = C3VD(sample() / "sample_current", ["cecum_t1_a"], normals="derived")
    assert [frame.number for frame in frames.frames] == [0, 60, 120, 180, 240]
    assert frames.poses("cecum_t1_a").shape == (276, 4, 4)
    item = frames[3]
    assert item["frame"] == 180
    assert item["image"].shape == (3, 1080, 1350)
    assert item["mask"].float().mean() > 0.8
    towards = (item["normals"] * item["rays"]).sum(dim=0)[item["mask"][0]]
    assert (towards < 0).all()


def test_normals_at_the_ends_of_their_codes() -> None:
    """All directions there and back, those that look away under the old release included."""
    generator = np.random.default_rng(0)
    normals = generator.normal(size=(40, 50, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    current = ((normals + 1) / 2 * 65535).round().astype(np.uint16)
    old = np.stack(
        [(normals[..., 0] + 1) / 2, (1 - normals[..., 1]) / 2, np.maximum(-normals[..., 2], 0)], axis=-1
    )
    for codes, release, largest in (
        (current, "current", 5e-3),
        ((old * 65535).round().astype(np.uint16), "pre_2023_05", 1.0),
    ):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            found = standard_normals(codes, release)
        angles = angle_between(found.double(), torch.from_numpy(normals).permute(2, 0, 1))
        assert angles.max() < largest
        assert angles.median() < 5e-3
    assert (standard_normals(np.zeros((2, 2, 3), np.uint16), "current") == 0).all()
    assert (standard_normals(np.zeros((2, 2, 3), np.uint16), "pre_2023_05") == 0).all()


def test_occlusion_is_read_where_it_is_stored(write_video, lens) -> None:
    root = write_video()
    hidden = np.zeros((108, 135), np.uint8)
    hidden[20:30, 40:60] = 255
    assert cv2.imwrite(str(root / "cecum_t1_a" / "0001_occlusion.png"), hidden)
    frames = C3VD(root, ["cecum_t1_a"], camera=lens)
    assert frames.occlusion(0) is None
    found = frames.occlusion(1)
    assert found is not None
    assert torch.equal(found[0], torch.from_numpy(hidden > 0))
    assert cv2.imwrite(str(root / "cecum_t1_a" / "0002_occlusion.png"), hidden[:50])
    with refused(DataError, root / "cecum_t1_a" / "0002_occlusion.png", "uint8 of shape"):
        frames.occlusion(2)
