"""Poses: each line, and whether they carry depth from frame to frame."""

import os
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from spheres import LENS, SIZE, Check, Write, faults, pose_of, said, see, write_poses

from col3d.data.checks import ExpectedVideo, FrameReport, plan_video
from col3d.data.checks.findings import Reprojection
from col3d.data.checks.poses import read_poses
from col3d.data.checks.reproject import reproject
from col3d.data.checks.video_summary import summarise_video
from col3d.data.datasets.c3vd import C3VD
from col3d.data.datasets.frame_set import Depth
from col3d.data.files.decode import read_whole
from col3d.geometry import Camera, FisheyeCamera, PinholeCamera, RadialTangentialCamera

SAMPLE = os.environ.get("COL3D_C3VD_SAMPLE")
needs_sample = pytest.mark.skipif(SAMPLE is None, reason="COL3D_C3VD_SAMPLE names no folder of real frames")


def lines_of(root: Path) -> tuple[Path, list[str]]:
    path = root / "cecum_t1_a" / "pose.txt"
    return path, path.read_text().splitlines()


def test_right_poses_carry_the_depth(write_sphere: Write, check: Check) -> None:
    found = check(write_sphere(numbers=range(6)))
    assert faults(found) == []
    assert (found.poses, found.pairs) == (True, 5)
    assert 0 < found.reprojection <= found.worst_reprojection < 0.05


CAMERAS: dict[str, Camera] = {
    "omnidirectional": LENS,
    "pinhole": PinholeCamera.from_focal(SIZE, 90.0, 90.0, 67.0, 53.5),
    "fisheye": FisheyeCamera.from_focal(SIZE, (70.0, 70.0), (67.0, 53.5), (-0.19, -0.004, 0.03, -0.013)),
    "wide fisheye": FisheyeCamera.from_focal(SIZE, (40.0, 40.0), (67.0, 53.5)),
    "radial_tangential": RadialTangentialCamera.from_focal(
        SIZE, (90.0, 90.0), (67.0, 53.5), (-0.1, 0.01, 0.0, 0.0, 0.0, 0.0), (0.002, -0.001)
    ),
}


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_reprojection_is_in_millimetres(camera: Camera) -> None:
    """A camera that moves 2 mm towards a wall sees it 2 mm nearer; believed to rest, it is 2 mm off.

    Depth that is stored where the lens sees nothing, or 90 degrees off its axis, counts for nothing.
    """
    wall = np.full(SIZE, 40.0, np.float32)
    known = np.ones(SIZE, bool)
    first, second = Depth(wall, known), Depth(wall - 2, known)
    rest, moved = np.eye(4), np.eye(4)
    moved[2, 3] = 2.0
    wrong = reproject(first, second, (rest, rest), camera, 1)
    assert wrong.median == pytest.approx(2.0, abs=1e-4)
    assert wrong.seen > 0.95
    right = reproject(first, second, (rest, moved), camera, 1)
    assert (right.median, right.step) == (pytest.approx(0, abs=1e-4), 2.0)


def test_cameras_that_look_elsewhere_are_not_compared() -> None:
    depth = Depth(np.full(LENS.size_hw, 40.0, np.float32), np.ones(LENS.size_hw, bool))
    away = np.diag([-1.0, 1.0, -1.0, 1.0])
    found = reproject(depth, depth, (np.eye(4), away), LENS, 1)
    assert found.seen < 0.01
    assert np.isnan(found.median)


@pytest.mark.parametrize("transposed", [False, True])
def test_both_ways_to_write_a_pose_are_read(tmp_path: Path, transposed: bool) -> None:
    poses = np.stack([pose_of(number) for number in range(3)])
    written = poses.transpose(0, 2, 1) if transposed else poses
    np.savetxt(tmp_path / "pose.txt", written.reshape(-1, 16), delimiter=",")
    found, lines, wrong = read_poses(tmp_path / "pose.txt", "v")
    assert (lines, wrong) == (3, [])
    np.testing.assert_allclose(np.stack([found[n] for n in range(3)]), poses)


def stretch(pose: np.ndarray) -> np.ndarray:
    pose[:3, 0] *= 1.01
    return pose


def mirror(pose: np.ndarray) -> np.ndarray:
    pose[:3, 0] *= -1
    return pose


def project(pose: np.ndarray) -> np.ndarray:
    pose[3, 3] = 2.0
    return pose


@pytest.mark.parametrize(
    ("damage", "named"), [(stretch, "off by 0.02"), (mirror, "determinant 1"), (project, "(0, 0, 0, 1)")]
)
def test_a_pose_that_is_none_is_named(
    write_sphere: Write, check: Check, damage: Callable[[np.ndarray], np.ndarray], named: str
) -> None:
    root = write_sphere(numbers=range(5))
    path, _ = lines_of(root)
    write_poses(path, [damage(pose_of(n)) if n == 2 else pose_of(n) for n in range(5)])
    found = check(root)
    assert faults(found) == [("poses", 2)]
    assert "pose.txt: line 3, of frame 2: " in said(found)
    assert named in said(found)
    assert found.pairs == 2  # 0 to 1 and 3 to 4


@pytest.mark.parametrize("line", ["1,2,3", "", "a" + ",0" * 15, "nan" + ",0" * 15])
def test_a_line_that_is_no_matrix_is_named(write_sphere: Write, check: Check, line: str) -> None:
    root = write_sphere(numbers=range(4))
    path, lines = lines_of(root)
    path.write_text("\n".join([*lines[:1], line, *lines[2:]]))
    found = check(root)
    assert faults(found) == [("poses", 1)]
    assert "pose.txt: line 2, of frame 1: " in said(found)


def test_poses_in_another_unit_are_a_fault(write_sphere: Write, check: Check) -> None:
    root = write_sphere(numbers=range(6))
    path, _ = lines_of(root)
    poses = [pose_of(number) for number in range(6)]
    for pose in poses:
        pose[:3, 3] *= 10  # such as of centimetres
    write_poses(path, poses)
    found = check(root)
    assert faults(found) == [("reprojection", number) for number in range(5)]
    assert "frame 0 into frame 1" in said(found)
    assert found.reprojection > 0.5


def test_one_pose_that_jumps_is_a_fault(write_sphere: Write, check: Check) -> None:
    root = write_sphere(numbers=range(6))
    path, _ = lines_of(root)
    poses = [pose_of(number) for number in range(6)]
    poses[3][:3, 3] += [0, 9, 0]
    write_poses(path, poses)
    assert faults(check(root)) == [("reprojection", 2), ("reprojection", 3)]


def test_a_jump_is_a_fault_between_neighbours_alone(write_sphere: Write, check: Check) -> None:
    root = write_sphere(numbers=(0, 2, 4))
    path, _ = lines_of(root)
    write_poses(path, [pose_of(6 * number) for number in range(5)])
    found = check(root)
    assert faults(found) == []
    assert found.reprojection > 0.5
    assert "into frame 2" in said(found)


@pytest.mark.parametrize("more", [-1, 1])
def test_there_is_a_line_for_each_frame(write_sphere: Write, check: Check, more: int) -> None:
    root = write_sphere(numbers=range(4))
    path, _ = lines_of(root)
    write_poses(path, [pose_of(number) for number in range(4 + more)])
    found = check(root)
    assert faults(found) == [("poses", None)]
    assert "4 frames" in said(found)
    assert f"got {4 + more}" in said(found)


def test_the_last_frame_of_a_part_has_a_line_too(write_sphere: Write, check: Check) -> None:
    root = write_sphere(numbers=(0, 3))
    path, _ = lines_of(root)
    write_poses(path, [pose_of(number) for number in range(3)])
    assert faults(check(root)) == [("poses", None)]


@pytest.mark.parametrize(
    ("step", "tenth", "wrong"), [(3.0, 0.01, True), (25.0, 0.01, False), (25.0, 0.9, True)]
)
def test_what_folds_may_hide_between_cameras_far_apart_is_no_fault(
    write_sphere: Write, frames: C3VD, step: float, tenth: float, wrong: bool
) -> None:
    root = write_sphere(numbers=(0, 1))
    plan = plan_video(frames, "cecum_t1_a", root / "cecum_t1_a")
    reports = [FrameReport("cecum_t1_a", number, in_full=True) for number in (0, 1)]
    reports[0].reprojection = Reprojection(to=1, step=step, seen=0.8, median=3.0, tenth=tenth)
    found = summarise_video(frames, plan, reports, ExpectedVideo({}))
    assert faults(found) == ([("reprojection", 0)] if wrong else [])
    assert "3.00 mm" in said(found)


def test_a_part_of_a_video_may_have_the_whole_poses(write_sphere: Write, check: Check) -> None:
    root = write_sphere(numbers=(0, 3))
    path, _ = lines_of(root)
    write_poses(path, [pose_of(number) for number in range(9)])
    assert faults(check(root)) == []


def test_without_poses(write_sphere: Write, check: Check) -> None:
    root = write_sphere()
    lines_of(root)[0].unlink()
    found = check(root)
    assert faults(found) == []
    assert "no poses" in said(found)
    assert faults(check(root, poses=True)) == [("poses", None)]


def test_frames_on_both_sides_of_a_chunk_are_compared(write_sphere: Write, check: Check) -> None:
    found = check(write_sphere(numbers=range(18)))
    assert found.pairs == 17
    assert faults(found) == []


def test_depth_that_another_camera_took_is_a_fault(write_sphere: Write, check: Check) -> None:
    root = write_sphere(numbers=range(4))
    depth, _, shown = see(pose_of(1))
    codes = np.rint((depth + 3) * shown * 655.35).astype(np.uint16)
    assert cv2.imwrite(str(root / "cecum_t1_a" / "0001_depth.tiff"), codes)
    assert {("reprojection", 0), ("reprojection", 1)} <= set(faults(check(root)))


@needs_sample
def test_real_poses_carry_real_depth() -> None:
    root = Path(str(SAMPLE)) / "sample_current"
    frames = C3VD(root, [])
    poses, lines, wrong = read_poses(root / "cecum_t1_a" / "pose.txt", "cecum_t1_a")
    assert (len(poses), lines, wrong) == (276, 276, [])
    depths = [
        frames.decoded_depth(read_whole(root / "cecum_t1_a" / f"{number:04d}_depth.tiff"))
        for number in (60, 120)
    ]
    assert reproject(*depths, (poses[60], poses[120]), frames.camera, 120).median < 0.05
    shifted = reproject(*depths, (poses[65], poses[120]), frames.camera, 120)
    assert shifted.median > 0.1
