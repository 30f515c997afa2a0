"""C3VD as it is handed out today: new names, C3VDv2's folders, archives in archives, videos without truth."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from refusals import refused

from col3d.data.datasets.c3vd import C3VD
from col3d.data.datasets.c3vdv2 import C3VDv2
from col3d.errors import DataError

Write = Callable[..., Path]
FOLDERS = {
    "color.png": "rgb/{}.png",
    "depth.tiff": "depth/{}_depth.tiff",
    "normals.tiff": "normals/{}_normals.tiff",
    "occlusion.png": "occlusions/{}_occlusion.tiff",
    "flow.tiff": "optical_flow/{}_flow.tiff",
}


def into_folders(video: Path) -> None:
    """From the flat layout to that of C3VDv2."""
    for old, new in FOLDERS.items():
        for path in video.glob(f"*_{old}"):
            target = video / new.format(path.name.split("_")[0])
            target.parent.mkdir(exist_ok=True)
            pixels = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
            assert cv2.imwrite(str(target), pixels)
            path.unlink()


def with_extras(video: Path) -> None:
    """Occlusion of the lower half, and a motion of (2, -3) pixels in its upper half."""
    codes = np.zeros((108, 135, 3), np.uint16)
    codes[:54, :, :2] = (np.array([2.0, -3.0]) + 20) / 40 * 65535
    occlusion = np.repeat(np.uint8([0, 255]), 54)[:, None].repeat(135, axis=1)
    for number in range(3):
        assert cv2.imwrite(str(video / f"{number:04d}_occlusion.png"), occlusion)
        assert cv2.imwrite(str(video / f"{number:04d}_flow.tiff"), codes[..., ::-1])
    (video / "0000_flow.tiff").unlink()


@pytest.mark.parametrize("folders", [False, True])
@pytest.mark.parametrize("name", ["cecum_t1_a", "c0_cecum_t1_v1", "c1v1"])
def test_one_video_under_any_name_in_any_layout(
    write_video: Write, lens: Any, name: str, folders: bool
) -> None:
    root = write_video("cecum_t1_a")
    with_extras(root / "cecum_t1_a")
    plain = C3VD(root, ["cecum_t1_a"], camera=lens)
    items, poses = [plain[index] for index in range(3)], plain.poses("cecum_t1_a")
    (root / "cecum_t1_a").rename(root / name)
    if folders:
        into_folders(root / name)
    for entry in ("cecum_t1_a", "c0_cecum_t1_v1", "c1v1", "c0_cecum_t1_v1:0-2"):
        frames = C3VD(root, [entry], camera=lens)
        assert frames.releases == {"cecum_t1_a": "current"}
        assert [frame.video for frame in frames.frames] == ["cecum_t1_a"] * 3
        for index, item in enumerate(items):
            found = frames[index]
            assert found["video"] == "cecum_t1_a"
            assert all(torch.equal(found[key], item[key]) for key in ("image", "depth", "normals", "mask"))
        assert torch.equal(frames.poses("cecum_t1_a"), poses)
        assert torch.equal(frames.poses("c0_cecum_t1_v1"), poses)
        occlusion = frames.occlusion(0)
        assert occlusion is not None
        assert occlusion[0, 54:].all()
        assert not occlusion[0, :54].any()
        assert frames.flow(0) is None
        flow = frames.flow(1)
        assert flow is not None
        assert flow[1][0, :54].all()
        assert not flow[1][0, 54:].any()
        assert (flow[0][:, 10, 10] - torch.tensor([2.0, -3.0])).abs().max() < 40 / 65535
    assert frames.renamed() == ({} if name == "cecum_t1_a" else {"cecum_t1_a": name})


def test_a_mixed_root(write_video: Write, lens: Any) -> None:
    for name in ("c0_cecum_t1_v1", "trans_t1_a", "c0_descending_t4_v1"):
        root = write_video(name)
    into_folders(root / "c0_descending_t4_v1")
    frames = C3VD(root, ["cecum_t1_a", "c0_transverse_t1_v1", "d4v2:0-1"], camera=lens)
    assert {frame.video for frame in frames.frames} == {"cecum_t1_a", "trans_t1_a", "desc_t4_a"}
    assert len(frames) == 8
    assert frames.renamed() == {"cecum_t1_a": "c0_cecum_t1_v1", "desc_t4_a": "c0_descending_t4_v1"}


def test_saturated_flow_does_not_count(write_video: Write, lens: Any) -> None:
    root = write_video()
    codes = np.full((108, 135, 3), 30000, np.uint16)
    codes[..., 2] = 0
    codes[0, 0, 0], codes[0, 1, 1], codes[0, 2, :2] = 65535, 0, 65534
    assert cv2.imwrite(str(root / "cecum_t1_a" / "0001_flow.tiff"), codes[..., ::-1])
    found = C3VD(root, ["cecum_t1_a"], camera=lens).flow(1)
    assert found is not None
    assert found[1][0, 0, :4].tolist() == [False, False, True, True]


def test_two_folders_of_one_video(write_video: Write, lens: Any) -> None:
    write_video("cecum_t1_a")
    root = write_video("c0_cecum_t1_v1")
    with refused(DataError, root / "cecum_t1_a", "c0_cecum_t1_v1"):
        C3VD(root, ["cecum_t1_a"], camera=lens)


def test_a_frame_in_both_layouts(write_video: Write, lens: Any) -> None:
    root = write_video()
    (root / "cecum_t1_a" / "rgb").mkdir()
    (root / "cecum_t1_a" / "0001_color.png").rename(root / "cecum_t1_a" / "rgb" / "0001.png")
    assert len(C3VD(root, ["cecum_t1_a"], camera=lens)) == 3  # each file once, wherever it lies
    (root / "cecum_t1_a" / "rgb" / "0002.png").write_bytes(
        (root / "cecum_t1_a" / "rgb" / "0001.png").read_bytes()
    )
    with refused(DataError, root / "cecum_t1_a" / "rgb" / "0002.png", "0002_color.png"):
        C3VD(root, ["cecum_t1_a"], camera=lens)


def test_an_archive_that_wraps_a_folder(write_video: Write, lens: Any) -> None:
    root = write_video("c1_cecum_t1_v1")
    (root / "c1_cecum_t1_v1").rename(root / "inner")
    (root / "c1_cecum_t1_v1").mkdir()
    (root / "inner").rename(root / "c1_cecum_t1_v1" / "c1_cecum_t1_v1")
    frames = C3VDv2(root, ["c1_cecum_t1_v1"], camera=lens)
    assert len(frames) == 3
    assert frames.renamed() == {}
    assert len(frames.poses("c1_cecum_t1_v1")) == 3


@pytest.mark.parametrize(
    ("kind", "name", "named"),
    [
        (C3VD, "c1_cecum_t1_v1", ("c1_cecum_t1_v1 ", "data=c3vdv2")),
        (C3VDv2, "cecum_t1_a", ("c0_cecum_t1_v1 ", "data=c3vd,")),
        (C3VDv2, "c1_cecum_t1_v4", ("c1_cecum_t1_v4 ", "deformation", "col3d predict", "col3d fuse")),
        (C3VDv2, "c1_full_t1_v1", ("c1_full_t1_v1 ", "screening ")),
        (C3VD, "screening_t1", ("screening_t1 ", "screening ")),
        (C3VD, "c0_full_t1_v1", ("screening_t1 ", "screening ")),
    ],
)
def test_videos_that_cannot_serve_are_refused_by_name(
    write_video: Write, lens: Any, kind: type[C3VD], name: str, named: tuple[str, ...]
) -> None:
    root = write_video(name)
    with refused(DataError, f"split entry '{name}'", *named):
        kind(root, [name], camera=lens)


def test_images_and_poses_of_a_video_without_truth(write_video: Write, lens: Any) -> None:
    root = write_video("c1_cecum_t1_v4")
    for path in (root / "c1_cecum_t1_v4").glob("*.tiff"):
        path.unlink()
    frames = C3VDv2(root, ["c1_cecum_t1_v4"], camera=lens, normals="none", truth=False)
    assert [sorted(frame.files) for frame in frames.frames] == [["color"]] * 3
    assert frames.image(2).shape == (108, 135, 3)
    assert len(frames.poses("c1_cecum_t1_v4")) == 3
    assert not frames.truth(0)["mask"].any()


@pytest.mark.parametrize(
    ("entry", "last"), [("cecum_t1_a:0-276", 275), ("c0_cecum_t1_v1:0-999", 275), ("mine:1-3", 2)]
)
def test_ranges_beyond_the_end(write_video: Write, lens: Any, entry: str, last: int) -> None:
    write_video("mine")
    root = write_video("cecum_t1_a")
    with refused(DataError, None, "split entry '", f" is {last}"):
        C3VD(root, [entry], camera=lens)


def test_a_part_of_a_known_video_may_lack_its_end(write_video: Write, lens: Any) -> None:
    assert len(C3VD(write_video(), ["cecum_t1_a:1-275"], camera=lens)) == 2
