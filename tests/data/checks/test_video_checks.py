"""What can be wrong with a whole video: files that are missing or there twice, numbers, pictures, stores."""

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from spheres import OLD, Check, Write, faults, said

from col3d.data.checks import (
    ExpectedVideo,
    Finding,
    FrameReport,
    check_chunk,
    duplicates,
    frames_to_show,
    plan_video,
)
from col3d.data.checks.stores import check_store, stores_beside
from col3d.data.checks.video import CHUNK
from col3d.data.checks.video_summary import summarise_video
from col3d.data.datasets.c3vd import C3VD


@pytest.mark.parametrize(
    ("missing", "remedy"),
    [
        ("0001_color.png", "copy it again"),
        ("0001_depth.tiff", "copy it again"),
        ("0001_normals.tiff", "data.normals=derived"),
    ],
)
def test_a_frame_without_one_of_its_files(
    write_sphere: Write, check: Check, missing: str, remedy: str
) -> None:
    root = write_sphere()
    (root / "cecum_t1_a" / missing).unlink()
    found = check(root)
    assert faults(found) == [("pair", 1)]
    for named in ("frame 1 ", missing, remedy):
        assert named in said(found)
    assert found.frames == 3


def test_a_file_without_its_frame(write_sphere: Write, check: Check) -> None:
    root = write_sphere()
    folder = root / "cecum_t1_a"
    shutil.copy(folder / "0001_normals.tiff", folder / "0007_normals.tiff")
    assert [fault for fault in faults(check(root)) if fault[0] == "pair"] == [("pair", 7), ("pair", 7)]


def test_a_kind_that_is_missing_altogether_is_said_once(write_sphere: Write, check: Check) -> None:
    root = write_sphere()
    for path in root.glob("*/*_normals.tiff"):
        path.unlink()
    found = check(root)
    assert faults(found) == [("pair", None)]
    for named in ("3 frames", "NNNN_normals.tiff", "data.normals=derived"):
        assert named in said(found)


def test_two_files_for_one_frame(write_sphere: Write, check: Check) -> None:
    root = write_sphere()
    folder = root / "cecum_t1_a"
    shutil.copy(folder / "0001_depth.tiff", folder / "1_depth.tiff")
    found = check(root)
    assert faults(found) == [("pair", 1)]
    assert " 0001_depth.tiff" in said(found)


def test_numbers_without_padding_are_found(write_sphere: Write, check: Check) -> None:
    root = write_sphere()
    for path in root.glob("*/*_color.png"):
        path.rename(path.with_name(f"{int(path.name[:4])}_color.png"))
    assert faults(check(root)) == []


@pytest.mark.parametrize(("count", "wrong"), [(3, False), (4, True)])
def test_the_number_of_frames(write_sphere: Write, check: Check, count: int, wrong: bool) -> None:
    root = write_sphere()
    found = check(root, frames={"current": count, "pre_2023_05": 99})
    assert found.expected == count
    assert (faults(found) == [("count", None)]) is wrong
    assert faults(check(root, frames={"current": count}, exactly=False)) == []


def test_the_number_of_frames_is_that_of_the_release(write_sphere: Write, check: Check) -> None:
    root = write_sphere(channels=OLD, clipped=True)
    assert faults(check(root, frames={"current": 9, "pre_2023_05": 3})) == []
    assert faults(check(root, frames={"current": 3, "pre_2023_05": 9})) == [("count", None)]


def test_a_folder_without_frames(tmp_path: Path, check: Check) -> None:
    (tmp_path / "data" / "cecum_t1_a").mkdir(parents=True)
    found = check(tmp_path / "data")
    assert faults(found) == [("count", None)]
    assert "NNNN_color.png" in said(found)


def test_a_picture_that_is_there_twice_in_a_video(write_sphere: Write, check: Check) -> None:
    root = write_sphere(numbers=range(4))
    folder = root / "cecum_t1_a"
    pixels = cv2.imread(str(folder / "0001_color.png"))
    assert cv2.imwrite(
        str(folder / "0003_color.png"), pixels, (cv2.IMWRITE_PNG_COMPRESSION, 9)
    )  # other bytes
    found = check(root)
    assert faults(found) == [("duplicate", 3)]
    assert "0003_color.png: " in said(found)
    assert "cecum_t1_a/0001_color.png" in said(found)
    assert found.duplicates == 1


def test_a_picture_that_is_there_twice_in_two_videos(write_sphere: Write, frames: C3VD) -> None:
    root = write_sphere()
    write_sphere("trans_t1_a")
    shutil.copy(root / "cecum_t1_a" / "0002_color.png", root / "trans_t1_a" / "0000_color.png")
    plans = {video: plan_video(frames, video, root / video) for video in ("cecum_t1_a", "trans_t1_a")}
    reports = {v: check_chunk(frames, p.chunks[0], lambda: None) for v, p in plans.items()}
    videos = {v: summarise_video(frames, plan, reports[v], ExpectedVideo({})) for v, plan in plans.items()}
    duplicates(videos, plans, [report for of_it in reports.values() for report in of_it])
    assert faults(videos["cecum_t1_a"]) == []
    assert faults(videos["trans_t1_a"]) == [("duplicate", 0)]
    assert "cecum_t1_a/0002_color.png" in said(videos["trans_t1_a"])


def test_unreadable_pictures_are_not_the_same(write_sphere: Write, check: Check) -> None:
    root = write_sphere()
    for path in root.glob("*/*_color.png"):
        path.write_bytes(b"")
    assert {rule for rule, _ in faults(check(root))} == {"file"}


def test_fast_reads_all_headers_and_eight_frames(write_sphere: Write, check: Check) -> None:
    root = write_sphere(numbers=range(40))
    found = check(root, fast=True)
    assert faults(found) == []
    assert (found.frames, found.in_full, found.pairs) == (40, 8, 4)
    cut = root / "cecum_t1_a" / "0021_color.png"
    content = bytearray(cut.read_bytes())
    content[len(content) // 2] ^= 1
    cut.write_bytes(content)
    assert faults(check(root, fast=True)) == []  # no header tells
    assert faults(check(root)) == [("file", 21)]
    cut.write_bytes(content[:-20])
    assert faults(check(root, fast=True)) == [("file", 21)]


def test_fast_decodes_all_of_a_short_video(write_sphere: Write, check: Check) -> None:
    found = check(write_sphere(numbers=range(8)), fast=True)
    assert (found.in_full, found.pairs) == (8, 7)


def test_a_long_video_is_cut_into_chunks(write_sphere: Write, frames: C3VD) -> None:
    root = write_sphere(numbers=range(CHUNK + 3))
    plan = plan_video(frames, "cecum_t1_a", root / "cecum_t1_a")
    assert [len(chunk.frames) for chunk in plan.chunks] == [CHUNK, 3]
    done = []
    check_chunk(frames, plan.chunks[1], lambda: done.append(1))
    assert len(done) == 3


def test_pictures_are_of_every_kind_of_fault_first(write_sphere: Write, frames: C3VD) -> None:
    root = write_sphere(numbers=range(60))
    write_sphere("trans_t1_a")
    plans = {video: plan_video(frames, video, root / video) for video in ("cecum_t1_a", "trans_t1_a")}
    reports = {
        video: [FrameReport(video, frame.number, in_full=True) for frame in plan.frames]
        for video, plan in plans.items()
    }
    findings = [Finding("file", f"broken {n}", "cecum_t1_a", n) for n in range(50)]
    findings += [
        Finding("depth", "no depth", "cecum_t1_a", 55),
        Finding("poses", "no frame", "cecum_t1_a", 99),
    ]
    shown = frames_to_show(plans, reports, findings)
    places = [(frame.video, frame.number) for frame, lines in shown if lines]
    assert len(places) == 40
    assert places[:3] == [("cecum_t1_a", 0), ("cecum_t1_a", 55), ("cecum_t1_a", 1)]
    healthy = [(frame.video, frame.number) for frame, lines in shown if not lines]
    assert [video for video, _ in healthy] == ["cecum_t1_a", "trans_t1_a"]
    assert healthy[0][1] in {*range(50, 55), *range(56, 60)}


def test_what_is_wrong_with_a_whole_video_is_shown_in_its_middle(write_sphere: Write, frames: C3VD) -> None:
    root = write_sphere()
    plans = {"cecum_t1_a": plan_video(frames, "cecum_t1_a", root / "cecum_t1_a")}
    reports = {"cecum_t1_a": [FrameReport("cecum_t1_a", n, in_full=True) for n in range(3)]}
    shown = frames_to_show(plans, reports, [Finding("normals", "of no release", "cecum_t1_a")])
    assert [(frame.number, lines) for frame, lines in shown] == [(1, ["of no release"])]


def test_stores(tmp_path: Path, write_sphere: Write, frames: C3VD) -> None:
    from col3d.data.cache import Recipe, write_video
    from col3d.data.sized import Resized

    root = write_sphere()
    store = tmp_path / "data_64x80"
    (tmp_path / "data_96x96" / "cecum_t1_a").mkdir(parents=True)  # another data set, not prepared frames
    recipe = Recipe("phantom", (64, 80), "stored", 100.0, frames.camera.resized((64, 80)))
    sphere = C3VD(root, ["cecum_t1_a"], camera=frames.camera)
    write_video(store, Resized(sphere, (64, 80)), recipe, lambda: None)
    assert stores_beside(root) == [store]
    (whole,) = check_store(store, fast=False)
    assert not whole.fault
    assert "1 prepared videos" in whole.text
    path = store / "cecum_t1_a" / "depth.npy"
    values = np.lib.format.open_memmap(path, mode="r+")
    values[1, 30, 40] ^= 1
    values.flush()
    assert [finding.fault for finding in check_store(store, fast=True)] == [False]
    (damaged,) = check_store(store, fast=False)
    assert damaged.fault
    assert str(path) in damaged.text
    path.write_bytes(path.read_bytes()[:-1])
    assert [finding.fault for finding in check_store(store, fast=True)] == [True]
    (store / "cecum_t1_a" / "index.json").write_text("{")
    assert [finding.fault for finding in check_store(store, fast=True)] == [True]
    assert str(tmp_path / "nowhere") in check_store(tmp_path / "nowhere", fast=True)[0].text
