"""Frames as others number and place them: offsets, time stamps, folders in folders, names like others'."""

import json
from decimal import Decimal
from pathlib import Path

import cv2
import numpy as np
import pytest
from refusals import refused

from col3d.data.cache import folder_of
from col3d.data.datasets.c3vd import C3VD
from col3d.data.datasets.folder import FolderFrames
from col3d.data.datasets.frame_files import refuse_twice
from col3d.data.datasets.frame_pairing import pair
from col3d.data.datasets.videos import canonical_name
from col3d.data.splits import parse_selection
from col3d.errors import DataError

HERE = Path("clip")


def files(*labels: str) -> dict[str, Path]:
    return {label: Path(f"{label}.png") for label in labels}


def pairs(
    images: list[str], depths: list[str], offset: int | None = None, tolerance: float = 0.02
) -> dict[str, str]:
    found = pair(HERE, files(*images), files(*depths), offset, tolerance, refuse_twice)
    both = found.images.keys() & found.depths.keys()
    return {found.images[number].stem: found.depths[number].stem for number in sorted(both)}


@pytest.mark.parametrize(
    ("images", "depths", "offset", "expected"),
    [
        (["0", "1"], ["0", "1"], None, {"0": "0", "1": "1"}),
        (["0000", "0001"], ["0", "1"], None, {"0000": "0", "0001": "1"}),
        (["1", "2", "3"], ["0", "1", "2"], None, {"1": "0", "2": "1", "3": "2"}),
        (
            ["0", "1", "2"],
            ["000001", "000002", "000003"],
            None,
            {"0": "000001", "1": "000002", "2": "000003"},
        ),
        (["1", "2", "3"], ["0", "1", "2"], 0, {"1": "1", "2": "2"}),
        (["100", "110"], ["0", "10"], -100, {"100": "0", "110": "10"}),
        (["1", "2", "4"], ["0", "1", "2"], None, {"1": "1", "2": "2"}),  # a gap: by number
    ],
)
def test_numbers(images: list[str], depths: list[str], offset: int | None, expected: dict[str, str]) -> None:
    assert pairs(images, depths, offset) == expected


def test_numbers_that_begin_far_apart_are_asked_about() -> None:
    with refused(DataError, None, "from 5", "from 0", "data.layout.depth_offset=-5"):
        pairs(["5", "6"], ["0", "1"])


def test_an_offset_that_was_told_is_said() -> None:
    found = pair(HERE, files("1", "2"), files("0", "1"), None, 0.02, refuse_twice)
    assert found.note == "clip: depth 0 is of image 1 (data.layout.depth_offset=-1)"
    assert pair(HERE, files("1", "2"), files("0", "1"), -1, 0.02, refuse_twice).note == ""


@pytest.mark.parametrize(
    ("images", "depths", "expected"),
    [
        (["10.170", "10.203"], ["10.170", "10.203"], {"10.170": "10.170", "10.203": "10.203"}),
        (["10.00", "10.03"], ["10.031", "9.99"], {"10.00": "9.99", "10.03": "10.031"}),
        (["10.00", "10.10"], ["10.101"], {"10.10": "10.101"}),
        # one depth, two images near to it: the nearer one has it
        (["10.000", "10.012"], ["10.010"], {"10.012": "10.010"}),
        # nanoseconds
        (["1403636579763555584"], ["1403636579770000000"], {"1403636579763555584": "1403636579770000000"}),
        # milliseconds
        (["1403636579763", "1403636579863"], ["1403636579861"], {"1403636579863": "1403636579861"}),
    ],
)
def test_time_stamps(images: list[str], depths: list[str], expected: dict[str, str]) -> None:
    assert pairs(images, depths) == expected


def test_time_stamps_as_a_slow_search_pairs_them() -> None:
    draw = np.random.default_rng(3)
    images = [f"{t:.6f}" for t in np.cumsum(draw.uniform(0.02, 0.05, 60)) + 1305031102]
    depths = [f"{float(t) + draw.normal(0, 0.008):.6f}" for t in images if draw.random() < 0.8]
    near = sorted((abs(Decimal(i) - Decimal(d)), i, d) for i in images for d in depths)
    expected: dict[str, str] = {}
    for apart, image, depth in near:
        if apart <= Decimal("0.02") and image not in expected and depth not in expected.values():
            expected[image] = depth
    assert pairs(images, depths) == expected


def test_time_stamps_too_far_apart_are_refused() -> None:
    with refused(DataError, None, "0.02 s", "0.250 s"):
        pairs(["10.0", "11.0"], ["10.25"])


@pytest.fixture
def root(tmp_path: Path) -> Path:
    plain = {"model": "pinhole", "size": [64, 64], "fx": 60.0, "fy": 60.0, "cx": 31.5, "cy": 31.5}
    (tmp_path / "camera.json").write_text(json.dumps(plain))
    return tmp_path


def write(folder: Path, number: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(folder / f"{number}.png"), np.full((64, 64, 3), 90, np.uint8))
    cv2.imwrite(str(folder / f"{number}_depth.png"), np.full((64, 64), 40, np.uint16))


def read(root: Path, *videos: str) -> FolderFrames:
    return FolderFrames(root, videos, "{}.png", "{}_depth.png", 1.0, 100.0, normals="none")


def test_videos_below_other_folders(root: Path) -> None:
    write(root / "dataset_1" / "keyframe_1", "0")
    write(root / "dataset_1" / "keyframe_2", "0")
    write(root / "dataset_2" / "keyframe_1" / "left", "0")
    write(root / "flat", "0")
    (root / "empty").mkdir()
    found = read(root, "dataset_1/keyframe_1", "dataset_2/keyframe_1/left:0-0", "flat")
    names = ["dataset_1/keyframe_1", "dataset_1/keyframe_2", "dataset_2/keyframe_1/left", "empty", "flat"]
    assert list(found.folders) == names
    assert [frame.video for frame in found.frames] == [
        "dataset_1/keyframe_1",
        "dataset_2/keyframe_1/left",
        "flat",
    ]
    assert folder_of(root, "dataset_1/keyframe_1") == root / "dataset_1__keyframe_1"


def test_layouts_with_folders_inside_a_video(root: Path) -> None:
    for number in "01":
        for kind, values in (
            ("rgb", np.zeros((64, 64, 3), np.uint8)),
            ("depth", np.ones((64, 64), np.uint16)),
        ):
            (root / "sets" / "clip" / kind).mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(root / "sets" / "clip" / kind / f"{number}.png"), values)
    found = FolderFrames(root, ["sets/clip"], "rgb/{}.png", "depth/{}.png", 1.0, 100.0, normals="none")
    assert [frame.number for frame in found.frames] == [0, 1]


def test_time_stamps_are_numbered_in_their_order(root: Path) -> None:
    for stamp in ("1305031102.209", "1305031102.170", "1305031102.1751"):
        write(root / "tum", stamp)
    found = read(root, "tum:0-1")
    assert [frame.files["color"].stem for frame in found.frames] == ["1305031102.170", "1305031102.1751"]
    assert "in the order of their time stamps" in found.notes[root / "tum"]


@pytest.mark.parametrize(
    "name", ["c1v1", "c0_cecum_t1_v1", "clip_under_review", "cecum_t1_a_under_review", "a_s1"]
)
def test_a_folder_that_is_called_so_is_meant(root: Path, name: str) -> None:
    write(root / name, "0")
    assert [frame.video for frame in read(root, name).frames] == [name]


def test_names_of_c3vd_while_it_was_under_review(root: Path) -> None:
    assert canonical_name("cecum_t1_a_under_review") == "cecum_t1_a"
    assert canonical_name("c0_cecum_t1_v1_under_review") == "cecum_t1_a"
    assert canonical_name("clip_under_review") == "clip_under_review"
    assert parse_selection("c1v1").video == "cecum_t1_a"
    (root / "cecum_t1_a_under_review").mkdir()
    assert list(C3VD.video_folders(root)) == ["cecum_t1_a"]
