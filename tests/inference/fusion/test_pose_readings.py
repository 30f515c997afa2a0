"""Poses written in every usual way are read for what they are, or refused before anything is fused."""

import codecs
import json
import shutil
from collections.abc import Callable
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from refusals import refused
from tiny_run import composed

from col3d.data.checks.poses import read_poses
from col3d.data.datasets.c3vd import C3VD
from col3d.errors import DataError, UserError
from col3d.inference.cameras import camera_at
from col3d.inference.fusion.fuse import fuse
from col3d.inference.fusion.pose_readings import AXES, DIRECTIONS, UNITS, PoseReading, find_reading

pytestmark = pytest.mark.end_to_end

VIDEO = "desc_t4_a"
AUTO = dict.fromkeys(("direction", "axes", "unit", "first"), "auto")
EVERY_READING = [PoseReading(*fields) for fields in product(DIRECTIONS, AXES, UNITS)]


@pytest.fixture
def video(rendered: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(rendered, tmp_path / "C3VD" / VIDEO))


def frames_of(video: Path) -> C3VD:
    return C3VD(video.parent, [VIDEO], normals="none", camera=camera_at(C3VD.lens(), (64, 80)))


def written_as(reading: PoseReading, true: np.ndarray) -> np.ndarray:
    """Poses that another program would have written; by hand, not by the code under test."""
    signs = np.diag([*AXES[reading.axes], 1.0])
    stored = np.array([signs @ pose @ signs for pose in true])
    stored[:, :3, 3] /= UNITS[reading.unit]
    return np.linalg.inv(stored) if reading.direction == "world_to_camera" else stored


def save(video: Path, poses: np.ndarray) -> None:
    lines = [",".join(f"{value:.12g}" for value in pose.T.reshape(-1)) for pose in poses]
    (video / "pose.txt").write_text("\n".join(lines) + "\n")


def fused(video: Path, output: Path, *options: str) -> float:
    sizes = ("voxel=2", "size=[64,80]", "accelerator=cpu")
    fuse(composed("fuse", f"video={video}", f"output={output}", *sizes, *options))
    comparisons = json.loads((output / "fusion.json").read_text())["comparisons"]
    return float(comparisons["truth to coverage_mesh.obj"]["accuracy_mean_mm"])


@pytest.mark.parametrize("reading", EVERY_READING, ids=str)
def test_a_reading_takes_stored_poses_back_to_the_true_ones(reading: PoseReading, video: Path) -> None:
    true = frames_of(video).poses(VIDEO).numpy()
    np.testing.assert_allclose(reading.camera_to_world(written_as(reading, true)), true, atol=1e-9)


@pytest.mark.parametrize("reading", EVERY_READING, ids=str)
def test_depth_tells_what_poses_mean(reading: PoseReading, video: Path) -> None:
    frames = frames_of(video)
    true = frames.poses(VIDEO).numpy()
    found, usual = (find_reading(frames, poses, AUTO) for poses in (written_as(reading, true), true))
    assert found.reading == reading
    assert found.apart == pytest.approx(usual.apart, rel=1e-6)
    assert (found.note == "") == (reading == PoseReading())


def renumbered(video: Path, by: int) -> None:
    for path in sorted(video.iterdir(), reverse=True):
        if path.name[:4].isdigit():
            path.rename(path.with_name(f"{int(path.name[:4]) + by:04d}{path.name[4:]}"))


@pytest.mark.parametrize("first", [1, 7])
def test_the_first_line_is_of_the_first_frame(
    video: Path, first: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = fused(video, tmp_path / "before")
    renumbered(video, first)
    assert fused(video, tmp_path / "after") == pytest.approx(before, rel=1e-6)
    assert f"note: pose.txt is read with poses.first={first}" in capsys.readouterr().out
    with refused(UserError, video.parent, "no line of pose.txt"):
        fused(video, tmp_path / "other", "poses.first=40")


def test_what_was_taken_is_said(video: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = fused(video, tmp_path / "before")
    reading = PoseReading("world_to_camera", "opengl", "m")
    save(video, written_as(reading, frames_of(video).poses(VIDEO).numpy()))
    capsys.readouterr()
    assert fused(video, tmp_path / "after") == pytest.approx(before, abs=0.02)
    said = "poses.direction=world_to_camera poses.axes=opengl poses.unit=m"
    assert f"note: pose.txt is read with {said}" in capsys.readouterr().out
    fused(video, tmp_path / "asked", *said.split())
    assert "note: pose.txt" not in capsys.readouterr().out


def test_a_reading_that_is_asked_for_and_wrong_is_refused(video: Path, tmp_path: Path) -> None:
    with refused(UserError, "pose.txt", "poses.unit=mm", "within 0."):
        fused(video, tmp_path / "out", "poses.unit=m")
    assert not (tmp_path / "out").exists()
    fused(video, tmp_path / "out", "poses.unit=m", "poses.check=false")


def test_poses_of_another_video_are_refused(video: Path, tmp_path: Path) -> None:
    frames = frames_of(video)
    poses = frames.poses(VIDEO).numpy()[::-1].copy()
    turn = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    for place in range(len(poses)):
        poses[place, :3, :3] = np.linalg.matrix_power(turn, place) @ poses[place, :3, :3]
    with refused(DataError, None, "poses.check=false"):
        find_reading(frames, poses, AUTO)


def test_poses_that_mirror_are_refused(video: Path, tmp_path: Path) -> None:
    poses = frames_of(video).poses(VIDEO).numpy()
    save(video, np.diag([1.0, -1, 1, 1]) @ poses)
    with refused(UserError, video / "pose.txt", "line 1 "):
        fused(video, tmp_path / "out")


def test_a_single_frame_has_nothing_to_be_held_against(
    video: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fused(Path(f"{video}:0-0"), tmp_path / "out")
    assert "note: no two frames see the same" in capsys.readouterr().out


def test_poses_that_stand_still_explain_nothing(
    video: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    poses = frames_of(video).poses(VIDEO).numpy()
    save(video, np.repeat(poses[:1], len(poses), axis=0))
    fused(video, tmp_path / "out")
    assert "the poses explain nothing of what changes" in capsys.readouterr().out


def test_poses_of_other_forms_are_refused_in_a_line(video: Path, tmp_path: Path) -> None:
    lines = (video / "pose.txt").read_text().splitlines()
    (video / "pose.txt").write_text("\n".join(",".join(line.split(",")[:12]) for line in lines))
    with refused(UserError, video / "pose.txt", "3 lines of 12", "append 0,0,0,1"):
        fused(video, tmp_path / "out")
    (video / "pose.txt").unlink()
    with refused(UserError, video / "pose.txt", "no such file"):
        fused(video, tmp_path / "out")


def texts(lines: list[str]) -> dict[str, bytes]:
    """The same poses as other programs write them."""
    text = "\n".join(lines) + "\n"
    spaced = text.replace(",", " ")
    return {
        "byte order mark": codecs.BOM_UTF8 + text.encode(),
        "CRLF": text.replace("\n", "\r\n").encode(),
        "both, and empty lines at the end": codecs.BOM_UTF8 + (text + "\n \n").replace("\n", "\r\n").encode(),
        "UTF-16 of a shell": text.encode("utf-16"),
        "UTF-16, the other order": codecs.BOM_UTF16_BE + text.encode("utf-16-be"),
        "spaces": spaced.encode(),
        "tabs": text.replace(",", "\t").encode(),
        "commas and spaces": text.replace(",", " , ").encode(),
        "semicolons": text.replace(",", ";").encode(),
        "spaces before and behind": "".join(f"  {line} \n" for line in spaced.splitlines()).encode(),
        "no line break at the end": text.rstrip().encode(),
    }


@pytest.mark.parametrize("form", texts([""]))
def test_text_of_other_programs_is_read(form: str, video: Path) -> None:
    true = frames_of(video).poses(VIDEO).numpy()
    path = video / "pose.txt"
    path.write_bytes(texts(path.read_text().splitlines())[form])
    np.testing.assert_array_equal(frames_of(video).poses(VIDEO).numpy(), true)
    found, lines, wrong = read_poses(path, VIDEO)
    assert (lines, wrong) == (len(true), [])
    np.testing.assert_array_equal(np.stack(list(found.values())), true)


def changed(change: Callable[[list[str]], list[str]]) -> Callable[[list[str]], bytes]:
    return lambda lines: "\n".join(change(lines)).encode()


def each(change: Callable[[list[str]], list[str]]) -> Callable[[list[str]], bytes]:
    return changed(lambda lines: [",".join(change(line.split(","))) for line in lines])


HEAD = "headers and comments"
OTHERS: dict[str, tuple[Callable[[list[str]], bytes], tuple[str, ...]]] = {
    "header": (changed(lambda lines: ["r00,r01", *lines]), ("line 1 ", "'r00'", HEAD)),
    "comment": (changed(lambda lines: ["# poses", *lines]), ("line 1 ", "'#'", HEAD)),
    "empty line first": (changed(lambda lines: ["", *lines]), ("line 1 ", "empty", HEAD)),
    "empty line between": (changed(lambda lines: [lines[0], "", *lines[1:]]), ("line 2 ", "empty")),
    "rows of matrices": (
        changed(lambda lines: [",".join(part) for line in lines for part in batched_by_four(line)]),
        ("12 lines of 4;", "four rows"),
    ),
    "quaternions": (each(lambda numbers: numbers[:7]), ("3 lines of 7;", "quaternions")),
    "quaternions with times": (each(lambda numbers: numbers[:8]), ("3 lines of 8;", "quaternions")),
    "3 x 4": (each(lambda numbers: numbers[:12]), ("3 lines of 12;", "append 0,0,0,1")),
    "numbers before": (each(lambda numbers: ["0", *numbers]), ("3 lines of 17;", "number or time")),
    "others": (each(lambda numbers: numbers[:9]), ("3 lines of 9",)),
    "one line shorter": (
        changed(lambda lines: [*lines[:2], lines[2].rpartition(",")[0]]),
        ("line 3 has 15",),
    ),
    "one number left out": (each(lambda numbers: ["", *numbers[1:]]), ("line 1 ", "commas", HEAD)),
    "a comma at the end": (each(lambda numbers: [*numbers, ""]), ("line 1 ", "commas", HEAD)),
    "nan": (each(lambda numbers: ["nan", *numbers[1:]]), ("line 1 ", "'nan'", HEAD)),
    "digits in groups": (each(lambda n: ["1_0", *n[1:]]), ("line 1 ", "'1_0'", HEAD)),
    "commas for points": (
        lambda lines: "\n".join(lines).replace(",", ";").replace(".", ",").encode(),
        ("3 lines of ",),
    ),
    "nothing": (lambda lines: b"", ("empty",)),
    "no text": (lambda lines: b"\xe9\xe9", ("UTF-8",)),
    "beyond all numbers": (each(lambda numbers: ["1e999", *numbers[1:]]), ("line 1 is no rotation",)),
}


def batched_by_four(line: str) -> list[list[str]]:
    numbers = line.split(",")
    return [numbers[k : k + 4] for k in range(0, len(numbers), 4)]


@pytest.mark.parametrize("form", OTHERS)
def test_other_forms_are_refused_by_line_and_remedy(form: str, video: Path) -> None:
    write, named = OTHERS[form]
    path = video / "pose.txt"
    path.write_bytes(write(path.read_text().splitlines()))

    with refused(DataError, path, "lines of 16", *named) as error:
        frames_of(video).poses(VIDEO)

    assert "\n" not in str(error.value)
    assert read_poses(path, VIDEO)[2] or form == "nothing"
