"""Every way to store normals is told from every other, and its camera too."""

import os
from itertools import permutations, product
from pathlib import Path

import cv2
import numpy as np
import pytest
from spheres import LENS, OLD, Channels, Check, Write, faults, pinhole_normals, pose_of, said, see, stored

from col3d.data.checks import CONVENTIONS, ExpectedVideo, FrameReport, plan_video
from col3d.data.checks.conventions import angles_of, off_lengths, ranked
from col3d.data.checks.video_summary import summarise_video
from col3d.data.datasets.c3vd import C3VD
from col3d.data.datasets.frame_set import Depth
from col3d.data.datasets.release import disagreement
from col3d.data.files.decode import read_whole

SAMPLE = os.environ.get("COL3D_C3VD_SAMPLE")
needs_sample = pytest.mark.skipif(SAMPLE is None, reason="COL3D_C3VD_SAMPLE names no folder of real frames")
ALL: list[tuple[Channels, bool]] = [
    (tuple(zip(axes, signs, strict=True)), clipped)
    for axes, signs, clipped in product(permutations(range(3)), product((1, -1), repeat=3), (False, True))
]


def name_of(channels: Channels, clipped: bool) -> str:
    words = [f"{'-' if sign < 0 else ''}{'xyz'[axis]}" for axis, sign in channels]
    return ", ".join(f"max({w}, 0)" if clipped and "z" in w else w for w in words)


def seen(number: int = 3) -> tuple[Depth, np.ndarray]:
    depth, normals, shown = see(pose_of(number))
    return Depth(depth.astype(np.float32), shown), normals


def best(codes: np.ndarray, depth: Depth) -> tuple[str, str, float, float]:
    """Channels and camera of the best convention, its angle, and that of the next."""
    angles = angles_of(codes, depth, LENS)
    assert angles is not None
    (first, angle), (_, second) = list(ranked([angles]).items())[:2]
    return first.channels, first.camera, angle, second


def test_there_are_96_for_each_camera() -> None:
    assert len(ALL) == 96
    for camera in ("lens", "pinhole"):
        names = [convention.channels for convention in CONVENTIONS if convention.camera == camera]
        assert sorted(names) == sorted(name_of(*way) for way in ALL)


@pytest.mark.parametrize("way", ALL, ids=lambda way: name_of(*way))
def test_each_is_found(way: tuple[Channels, bool]) -> None:
    depth, normals = seen()
    channels, camera, angle, second = best(stored(normals, *way), depth)
    assert (channels, camera) == (name_of(*way), "lens")
    assert angle < 0.5
    assert second > 2


@pytest.mark.parametrize("way", ALL[::13], ids=lambda way: name_of(*way))
def test_normals_made_for_a_pinhole_are_told_by_it(way: tuple[Channels, bool]) -> None:
    depth, _ = seen()
    channels, camera, angle, second = best(stored(pinhole_normals(depth.mm.astype(float)), *way), depth)
    assert (channels, camera) == (name_of(*way), "pinhole")
    assert angle < 0.5
    assert second > 2


def test_both_releases_have_their_names() -> None:
    named = {convention.release: convention for convention in CONVENTIONS if convention.release}
    assert set(named) == {"current", "pre_2023_05"}
    assert (named["current"].channels, named["current"].camera) == ("x, y, z", "lens")
    assert (named["pre_2023_05"].channels, named["pre_2023_05"].camera) == (name_of(OLD, True), "lens")


def test_depth_of_8_bits_will_do_at_full_size() -> None:
    """In steps of 0.4 mm single pixels have useless normals; blocks of them do not."""
    camera = LENS.resized((1080, 1350))
    depth, normals, _ = see(pose_of(3), camera)
    coarse = Depth((np.rint(depth / 0.4) * 0.4).astype(np.float32), np.ones(depth.shape, bool))
    angles = angles_of(stored(normals, ((1, 1), (0, -1), (2, 1)), False), coarse, camera)
    assert angles is not None
    (first, angle), *_ = ranked([angles]).items()
    assert (first.channels, first.camera) == ("y, -x, z", "lens")
    assert angle < 6


def test_too_little_depth_tells_nothing() -> None:
    depth, normals = seen()
    few = np.zeros_like(depth.known)
    few[50:53, 60:63] = True
    assert angles_of(stored(normals, OLD, True), Depth(depth.mm, few), LENS) is None


@pytest.mark.parametrize(("clipped", "encoding"), [(False, 0), (True, 3)])
def test_unit_length_is_that_of_the_encoding(clipped: bool, encoding: int) -> None:
    depth, normals = seen()
    codes = stored(normals, OLD, clipped)
    shares = off_lengths(codes, depth.known, 0.01)
    assert shares[encoding] == 0
    assert max(shares) > 0.5  # what would have been said, had the encoding been mistaken
    codes[:54] = codes[:54] // 2 + 9000
    assert 0.4 < off_lengths(codes, depth.known, 0.01)[encoding] < 0.6


def test_cut_off_normals_may_be_shorter_but_not_longer() -> None:
    codes = np.zeros((10, 10, 3), np.uint16)
    codes[..., 0], codes[..., 1] = 45000, 30000
    assert off_lengths(codes, np.ones((10, 10), bool), 0.01)[3] == 0
    codes[..., 0] = codes[..., 1] = 65535
    assert off_lengths(codes, np.ones((10, 10), bool), 0.01)[3] == 1


def test_a_video_of_each_release_has_no_fault(write_sphere: Write, check: Check) -> None:
    found = check(write_sphere())
    assert (found.release, found.normals, found.camera) == ("current", "(x, y, z)", "lens")
    assert faults(found) == []
    old = check(write_sphere("cecum_t1_b", channels=OLD, clipped=True), "cecum_t1_b")
    assert (old.release, old.normals) == ("pre_2023_05", "(x, -y, max(-z, 0))")
    assert faults(old) == []
    assert old.off_length == 0


def test_the_release_that_is_asked_for_is_held_against_the_normals(write_sphere: Write, check: Check) -> None:
    root = write_sphere(channels=OLD, clipped=True)
    assert faults(check(root, release="pre_2023_05")) == []
    found = check(root, release="current")
    assert faults(found) == [("normals", None)]
    assert "release pre_2023_05" in said(found)
    assert "data.release=current" in said(found)


def test_normals_of_no_release_are_a_fault(write_sphere: Write, check: Check) -> None:
    found = check(write_sphere(channels=((0, 1), (1, -1), (2, 1))))
    assert faults(found) == [("normals", None)]
    assert "got (x, -y, z): 0." in said(found)


def test_normals_of_a_pinhole_are_a_fault(write_sphere: Write, check: Check) -> None:
    found = check(write_sphere(pinhole=True))
    assert (found.normals, found.camera) == ("(x, y, z)", "pinhole")
    assert faults(found) == [("normals", None)]
    assert "got (x, y, z) of a pinhole" in said(found)


@pytest.mark.parametrize(("behind", "camera"), [(0.9, "lens"), (1.1, "pinhole")])
def test_a_release_that_is_as_good_is_believed(
    write_sphere: Write, frames: C3VD, behind: float, camera: str
) -> None:
    """Depth and normals of few bits do not tell the best two apart."""
    root = write_sphere(numbers=(0,))
    angles = np.full(len(CONVENTIONS), 50.0, np.float32)
    for place, convention in enumerate(CONVENTIONS):
        if convention.channels == "x, y, z":
            angles[place] = 4.0 + (behind if convention.camera == "lens" else 0.0)
    report = FrameReport("cecum_t1_a", 0, in_full=True, angles=angles, off_length=(0.0, 0.0, 0.0, 0.0))
    plan = plan_video(frames, "cecum_t1_a", root / "cecum_t1_a")
    found = summarise_video(frames, plan, [report], ExpectedVideo({}))
    assert found.camera == camera
    assert (faults(found) == []) == (camera == "lens")


def test_normals_of_another_scene_are_a_fault(write_sphere: Write, check: Check) -> None:
    root = write_sphere(numbers=(0, 1))
    for path in root.glob("*/*_normals.tiff"):
        noise = np.random.default_rng(0).normal(size=(*LENS.size_hw, 3))
        noise /= np.linalg.norm(noise, axis=-1, keepdims=True)
        write_codes(path, stored(noise, OLD, False))
    found = check(root)
    assert faults(found) == [("normals", None)]


def test_one_frame_that_is_stored_otherwise_is_named(write_sphere: Write, check: Check) -> None:
    root = write_sphere(numbers=(0, 1, 2, 3))
    _, normals, shown = see(pose_of(2))
    other = stored(normals, ((1, 1), (0, 1), (2, -1)), False) * shown[..., None]
    write_codes(root / "cecum_t1_a" / "0002_normals.tiff", other)
    found = check(root)
    assert faults(found) == [("normals", 2)]
    for named in ("0002_normals.tiff: ", "(x, y, z)", "(y, x, -z)"):
        assert named in said(found)


def test_one_frame_that_is_stored_nearly_the_same_is_named(write_sphere: Write, check: Check) -> None:
    """(x, y, max(z, 0)) read as (x, y, z) is but 5 degrees off in the median."""
    root = write_sphere(numbers=(0, 1, 2, 3))
    _, normals, shown = see(pose_of(2))
    other = stored(normals, ((0, 1), (1, 1), (2, 1)), True) * shown[..., None]
    write_codes(root / "cecum_t1_a" / "0002_normals.tiff", other)
    found = check(root)
    assert ("normals", 2) in faults(found)
    assert {frame for _, frame in faults(found)} == {2}


def write_codes(path: Path, codes: np.ndarray) -> None:
    assert cv2.imwrite(str(path), np.ascontiguousarray(codes[..., ::-1]))


@needs_sample
@pytest.mark.parametrize(
    ("folder", "stem", "release", "channels"),
    [
        ("sample_current", "0000", "current", "x, y, z"),
        ("sample_pre_2023_05", "0", "pre_2023_05", "x, -y, max(-z, 0)"),
    ],
)
def test_real_frames(folder: str, stem: str, release: str, channels: str) -> None:
    place = Path(str(SAMPLE)) / folder / "unknown_frame"
    frames = C3VD(place.parent, [])
    codes = read_whole(place / f"{stem}_normals.tiff")
    depth = frames.decoded_depth(read_whole(place / f"{stem}_depth.tiff"))
    angles = angles_of(codes, depth, frames.camera)
    assert angles is not None
    ranking = ranked([angles])
    found = next(iter(ranking))
    assert (found.release, found.channels) == (release, channels)
    assert ranking[found] < 2.5
    assert min(angle for c, angle in ranking.items() if c.camera == "pinhole") > 15  # the true lens beats it
    assert off_lengths(codes, depth.known, 0.01)[0 if release == "current" else 3] == 0
    item = C3VD(place.parent, ["unknown_frame"])[0]
    known = disagreement(codes, item["depth"], item["mask"], frames.camera)
    assert ranking[found] == pytest.approx(known[release], abs=0.1)  # as the data set itself tells them apart
