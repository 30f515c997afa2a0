"""The lens: through the right one, depth carried by the poses meets depth, on real frames and on a sphere."""

import os
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
from spheres import LENS, Write

from col3d.data.checks import plan_video
from col3d.data.checks.lens import check_lens, readings_of
from col3d.data.checks.poses import read_poses
from col3d.data.checks.reproject import surface_error
from col3d.data.datasets.c3vd import C3VD
from col3d.data.files.decode import read_whole
from col3d.geometry import OmnidirectionalCamera, PinholeCamera

SAMPLE = os.environ.get("COL3D_C3VD_SAMPLE")
needs_sample = pytest.mark.skipif(SAMPLE is None, reason="COL3D_C3VD_SAMPLE names no folder of real frames")
TRUE, TRANSPOSED, NONE = "[[c, e], [d, 1]]", "[[c, d], [e, 1]]", "identity"


@needs_sample
def test_c3vds_lens_carries_real_depth_to_a_third_of_a_code() -> None:
    """All ordered pairs of five frames, every hundredth pixel: no free number, nothing to argue with."""
    root = Path(str(SAMPLE)) / "sample_current"
    frames = C3VD(root, ["cecum_t1_a"], normals="none")
    poses, _, _ = read_poses(root / "cecum_t1_a" / "pose.txt", "cecum_t1_a")
    depths = {f.number: frames.decoded_depth(read_whole(f.files["depth"])) for f in frames.frames}
    assert sorted(depths) == [0, 60, 120, 180, 240]
    errors = {
        name: [
            surface_error(depths[one], depths[other], (poses[one], poses[other]), camera)
            for one, other in permutations(depths, 2)
        ]
        for name, camera in OmnidirectionalCamera.c3vd().stretch_forms().items()
    }
    assert max(errors[TRUE]) < 0.001
    assert all(wrong > 5 * right for right, wrong in zip(errors[TRUE], errors[TRANSPOSED], strict=True))
    assert all(wrong > 2 * right for right, wrong in zip(errors[TRUE], errors[NONE], strict=True))
    assert np.median(errors[TRANSPOSED]) > 20 * np.median(errors[TRUE])


@needs_sample
def test_the_check_of_a_video_finds_it_too() -> None:
    root = Path(str(SAMPLE)) / "sample_current"
    frames = C3VD(root, [], normals="none")
    report = check_lens(frames, plan_video(frames, "cecum_t1_a", root / "cecum_t1_a"))
    assert report.pairs == 20
    assert list(report.errors) == [TRUE, TRANSPOSED, NONE]
    assert report.errors[TRUE] < 0.0006
    assert report.errors[TRANSPOSED] > 0.02


C, D, E = 0.999986882249990, 0.00288273829525059, -0.00296316513429569
CENTRE = np.array([678.544839263292, 542.975887548343])
STRETCHES = {TRUE: [[C, E], [D, 1]], TRANSPOSED: [[C, D], [E, 1]], NONE: [[1, 0], [0, 1]]}


def height(r: np.ndarray) -> np.ndarray:
    return (
        769.243600037458
        - 0.000812770624150226 * r**2
        + 6.25674244578925e-07 * r**3
        - 1.19662182144280e-09 * r**4
    )


def carried_by_hand(
    one: np.ndarray, other: np.ndarray, other_from_one: np.ndarray, stretch: np.ndarray, step: int
) -> np.ndarray:
    """Codes of depth carried from frame to frame: z - depth there in mm, NaN where that is not compared."""
    v, u = (grid.ravel() for grid in np.mgrid[step // 2 : 1080 : step, step // 2 : 1350 : step])
    known = (one[v, u] >= 1) & (one[v, u] < 65535)
    plane = np.linalg.solve(stretch, (np.stack([u, v], axis=1) - CENTRE).T)
    direction = np.concatenate([plane / height(np.hypot(*plane)), np.ones((1, len(u)))])
    x, y, z = other_from_one[:3, :3] @ (direction * one[v, u] * 100 / 65535) + other_from_one[:3, 3:]
    across, low, high = np.hypot(x, y), np.zeros(len(x)), np.full(len(x), 1000.0)
    for _ in range(60):  # the radius at which the ray has this slope, by halving
        middle = (low + high) / 2
        below = height(middle) * across > z * middle
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    found = (stretch @ (np.stack([x, y]) / across * low)).T + CENTRE
    inside = known & (found >= 0).all(axis=1) & (found < [1349, 1079]).all(axis=1)
    found = np.where(inside[:, None], found, 0.0)
    (left, top), (right, down) = found.astype(int).T, (found % 1).T
    four = np.stack([other[top + row, left + column] for row in (0, 1) for column in (0, 1)])
    weights = np.stack([(1 - down) * (1 - right), (1 - down) * right, down * (1 - right), down * right])
    there = (weights * four).sum(axis=0) * 100 / 65535
    kept = inside & ((four > 0) & (four < 65535)).all(axis=0)
    kept &= np.abs(four[0].astype(float) - four[1] - four[2] + four[3]) * 100 / 65535 <= 1e-4 * there
    kept &= z <= 1.01 * there
    return np.where(kept, z - there, np.nan)


def real_codes() -> tuple[dict[int, np.ndarray], np.ndarray]:
    folder = Path(str(SAMPLE)) / "sample_current" / "cecum_t1_a"
    codes = {number: read_whole(folder / f"{number:04d}_depth.tiff") for number in range(0, 241, 60)}
    return codes, np.loadtxt(folder / "pose.txt", delimiter=",").reshape(-1, 4, 4).transpose(0, 2, 1)


@needs_sample
def test_a_twin_that_shares_no_code_finds_the_same() -> None:
    root = Path(str(SAMPLE)) / "sample_current"
    frames = C3VD(root, [], normals="none")
    codes, poses = real_codes()
    depths = {number: frames.decoded_depth(values) for number, values in codes.items()}
    for one, other in ((0, 60), (240, 0)):
        for name, camera in OmnidirectionalCamera.c3vd().stretch_forms().items():
            pair = (poses[one], poses[other])
            found = surface_error(depths[one], depths[other], pair, camera)
            moved = np.linalg.inv(pair[1]) @ pair[0]
            off = carried_by_hand(codes[one], codes[other], moved, np.array(STRETCHES[name]), 10)
            assert found == pytest.approx(np.nanmedian(np.abs(off)), rel=0.02)


@needs_sample
def test_codes_are_cut_not_rounded() -> None:
    """Codes that stand for depth d too near leave carried points off by -d (g - 1).

    Where depth of the one frame is raised by 1 mm, what is carried comes to lie g mm further from the surface
    of the other: g tells along and across it, and is found by raising it.
    """
    codes, poses = real_codes()
    stretch, raised = np.array(STRETCHES[TRUE]), 20
    offs, growths = [], []
    for one, other in permutations(codes, 2):
        moved = np.linalg.inv(poses[other]) @ poses[one]
        off = carried_by_hand(codes[one], codes[other], moved, stretch, 5)
        higher = carried_by_hand(codes[one].astype(float) + raised, codes[other], moved, stretch, 5)
        growth = (higher - off) / (raised * 100 / 65535)
        clean = (np.abs(off) < 0.004) & (np.abs(growth - 1) < 3)
        offs.append(off[clean])
        growths.append(growth[clean])
    slope = np.polyfit(np.concatenate(growths) - 1, np.concatenate(offs), 1)[0]
    assert slope == pytest.approx(-0.5 * 100 / 65535, rel=0.1)


def lens_frames(root: Path, camera: OmnidirectionalCamera = LENS) -> C3VD:
    return C3VD(root, [], camera=camera)


def test_a_sphere_knows_its_lens(write_sphere: Write) -> None:
    root = write_sphere(numbers=range(12))
    frames = lens_frames(root)
    report = check_lens(frames, plan_video(frames, "cecum_t1_a", root / "cecum_t1_a"))
    assert report.pairs == 18
    assert min(report.errors, key=lambda name: report.errors[name]) == TRUE
    assert report.errors[TRUE] < 0.01


def test_readings_are_those_of_the_whole_lens_at_the_size_of_the_frames() -> None:
    found = readings_of(lens_frames(Path()))
    forms = OmnidirectionalCamera.c3vd().stretch_forms()
    assert found == {name: camera.resized(LENS.size_hw) for name, camera in forms.items()}
    pinhole = PinholeCamera.c3vd()
    assert readings_of(C3VD(Path(), [], camera=pinhole)) == {"as given": pinhole}
