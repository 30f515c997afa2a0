"""col3d verify as a user calls it: exit codes, what is on screen, and the files it writes."""

import json
import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from programs import call
from refusals import refused
from tiny_run import composed, real_frames

from col3d.data.cache import Recipe, write_video
from col3d.data.cache.choice import remember
from col3d.data.checks.verify import verify
from col3d.data.datasets.c3vd import C3VD
from col3d.data.sized import Resized
from col3d.errors import DataError, UserError
from col3d.geometry import OmnidirectionalCamera
from col3d.phantom import PARTS, PhantomSettings, phantom_camera, render_phantom

pytestmark = pytest.mark.end_to_end

VIDEOS = ("cecum_t1_a", "trans_t1_a")
PHANTOM = ("phantom.size=[108,135]", "phantom.frames_per_video=6")
SPLIT = ("data/split=custom", "data.split.train=[cecum_t1_a]", "data.split.test=[trans_t1_a:0-2]")


@pytest.fixture(scope="module")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("verified") / "frames"
    settings = PhantomSettings(size_hw=(108, 135), frames_per_video=6, videos=VIDEOS)
    render_phantom(root, settings, workers=1, progress=False)
    return root


@pytest.fixture
def root(rendered: Path, tmp_path: Path) -> Path:
    """A copy, to be broken."""
    return Path(shutil.copytree(rendered, tmp_path / "frames"))


def run(root: Path, *overrides: str, code: int = 0) -> dict[str, Any]:
    """What verify.json says, and that it ended as it should."""
    out = root.parent / "out"
    given = composed(
        "verify",
        "data=phantom",
        *PHANTOM,
        *SPLIT,
        f"data.root={root}",
        f"output={out}",
        "workers=1",
        *overrides,
    )
    if code:
        with pytest.raises(SystemExit) as end:
            verify(given)
        assert end.value.code == code
    else:
        verify(given)
    assert "<h1>" in (out / "verify.html").read_text(encoding="utf-8")
    content: dict[str, Any] = json.loads((out / "verify.json").read_text(encoding="utf-8"))
    return content


def faults(facts: dict[str, Any]) -> list[tuple[str, str, int | None]]:
    return [(f["rule"], f["video"], f["frame"]) for f in facts["findings"] if f["fault"]]


def test_a_healthy_phantom(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    facts = run(root)
    assert (facts["faults"], facts["notes"], facts["findings"]) == (0, 0, [])
    assert (facts["frames"], facts["in_full"], facts["fast"]) == (12, 12, False)
    assert [video["video"] for video in facts["videos"]] == list(VIDEOS)
    for video in facts["videos"]:
        assert (video["frames"], video["expected"], video["pairs"]) == (6, 6, 5)
        assert (video["normals"], video["camera"], video["release"]) == ("(x, y, z)", "lens", "current")
        assert video["angle"] < 1
        assert video["reprojection"] < 0.05
    best = facts["ranking"][0]
    assert (best["normals"], best["camera"], best["release"]) == ("(x, y, z)", "lens", "current")
    assert [row["angle"] for row in facts["ranking"]] == sorted(row["angle"] for row in facts["ranking"])
    screen = capsys.readouterr().out
    for part in ("cecum_t1_a", "6/6", "108 x 135", "of the lens, release current", "0 faults and 0 notes"):
        assert part in screen
    assert (root.parent / "out" / "verify.html").read_text().count("<figure>") == 2


def test_a_phantom_that_draws_everything_and_its_flow(tmp_path: Path) -> None:
    root, video = tmp_path / "frames", "sigmoid_t2_a_s5"
    settings = PhantomSettings((108, 135), 6, randomise=PARTS, videos=(video,))
    render_phantom(root, settings, workers=1, progress=False)
    split = (f"data.split.train=[{video}]", f"data.split.test=[{video}]", "data.randomise=true")
    assert run(root, *split)["findings"] == []
    cut = root / video / "0003_flow.tiff"
    cut.write_bytes(cut.read_bytes()[:-100])
    assert faults(run(root, *split, code=1)) == [("file", video, 3)]


def test_what_is_broken_is_named(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first, second = root / "cecum_t1_a", root / "trans_t1_a"
    cut = first / "0001_color.png"
    cut.write_bytes(cut.read_bytes()[:-100])
    (first / "0004_normals.tiff").unlink()
    shutil.copy(first / "0000_color.png", second / "0005_color.png")
    depth = cv2.imread(str(second / "0002_depth.tiff"), cv2.IMREAD_UNCHANGED)
    cv2.imwrite(str(second / "0002_depth.tiff"), np.zeros_like(depth))
    facts = run(root, code=1)
    assert sorted(faults(facts)) == [
        ("depth", "trans_t1_a", 2),
        ("duplicate", "trans_t1_a", 5),
        ("file", "cecum_t1_a", 1),
        ("pair", "cecum_t1_a", 4),
    ]
    assert [video["faults"] for video in facts["videos"]] == [2, 2]
    assert facts["faults"] == 4
    screen = capsys.readouterr().out
    assert f"fault: {cut}: the file is cut off; copy it again\n" in screen
    assert "4 faults and 0 notes; 12 frames of 2 videos, 12 decoded" in screen
    page = (root.parent / "out" / "verify.html").read_text()
    assert page.count("<figure>") == 6  # four that are broken, and a healthy one of each video
    assert page.count("data:image/jpeg;base64,") == 6


def test_the_lens_is_measured_and_ranked(root: Path) -> None:
    facts = run(root)
    assert [row["reading"] for row in facts["lens"]] == ["[[c, e], [d, 1]]", "identity", "[[c, d], [e, 1]]"]
    assert facts["lens"][0]["own"]
    assert facts["lens"][0]["error"] < 0.01
    for video in facts["videos"]:
        assert video["flow"] < 0.01


def test_frames_of_another_lens_are_a_fault(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a copy rendered through the transposed stretch matrix would look like."""
    root, video = tmp_path / "frames", "cecum_t1_a"
    true = OmnidirectionalCamera.c3vd()
    other = true.stretch_forms()["[[c, d], [e, 1]]"]
    with monkeypatch.context() as patch:
        patch.setattr(OmnidirectionalCamera, "c3vd", classmethod(lambda _: other))
        settings = PhantomSettings(size_hw=(540, 675), frames_per_video=6, videos=(video,))
        render_phantom(root, settings, workers=1, progress=False)
    split = (f"data.split.train=[{video}]", f"data.split.test=[{video}]", "phantom.size=[540,675]")
    facts = run(root, *split, code=1)
    assert faults(facts) == [("lens", video, None)]
    assert facts["lens"][0]["reading"] == "[[c, d], [e, 1]]"
    assert "[[c, e], [d, 1]]" in facts["findings"][0]["text"]


def test_flow_that_points_the_other_way_is_a_fault(root: Path) -> None:
    path = root / "cecum_t1_a" / "0002_flow.tiff"
    codes = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    known = codes.any(axis=-1, keepdims=True)
    turned = np.where(known & (np.arange(3) > 0), 65535 - codes, 0).astype(np.uint16)
    assert cv2.imwrite(str(path), turned)
    assert faults(run(root, code=1)) == [("flow", "cecum_t1_a", 2)]
    turned[..., 0] = 7
    assert cv2.imwrite(str(path), turned)
    assert faults(run(root, code=1)) == [("flow", "cecum_t1_a", 2)] * 2


def test_a_coverage_mesh_is_read(root: Path) -> None:
    path = root / "cecum_t1_a" / "coverage_mesh.obj"
    text = path.read_text()
    path.write_text(text + "f 1/3 2/3 3/3\n")
    assert faults(run(root, code=1)) == [("coverage", "cecum_t1_a", None)]
    path.write_text("\n".join(line for line in text.splitlines() if line.startswith("v ")) + "\nf 1 2 3\n")
    facts = run(root)
    assert [(f["rule"], f["fault"]) for f in facts["findings"]] == [("coverage", False)]


def test_videos_of_today_s_names_and_of_other_kinds(
    tmp_path: Path, rendered: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = tmp_path / "C3VDv2"
    for name in ("c1_cecum_t1_v1", "c1_cecum_t1_v4", "c0_transverse_t1_v1"):
        shutil.copytree(rendered / "trans_t1_a", root / name)
    for path in (root / "c1_cecum_t1_v4").iterdir():
        if "_color" not in path.name and path.name != "pose.txt":
            path.unlink()
    with pytest.raises(SystemExit):
        verify(
            composed("verify", "data=c3vdv2", f"data.root={root}", f"output={tmp_path / 'out'}", "workers=1")
        )
    facts = json.loads((tmp_path / "out" / "verify.json").read_text())
    found = {video["video"]: video for video in facts["videos"]}
    assert found.keys() == {"c1_cecum_t1_v1", "c1_cecum_t1_v4"}
    assert (found["c1_cecum_t1_v1"]["expected"], found["c1_cecum_t1_v4"]["expected"]) == (218, 602)
    notes = [f["text"] for f in facts["findings"] if not f["fault"]]
    assert any("c0_transverse_t1_v1 is a video of c3vd" in note for note in notes)
    assert not any(f["rule"] == "pair" for f in facts["findings"])
    assert "1 of 3 videos lie under other names: c0_transverse_t1_v1 is trans_t1_a" in capsys.readouterr().out


def test_a_missing_video_is_a_fault_unless_it_may_be(root: Path) -> None:
    shutil.rmtree(root / "trans_t1_a")
    facts = run(root, code=1)
    assert faults(facts) == [("missing", "trans_t1_a", None)]
    assert "split custom" in facts["findings"][0]["text"]
    assert faults(run(root, "data.allow_missing=true")) == []


def test_a_frame_too_few_is_a_fault(root: Path) -> None:
    for path in (root / "cecum_t1_a").glob("0005_*"):
        path.unlink()
    pose = root / "cecum_t1_a" / "pose.txt"
    pose.write_text("\n".join(pose.read_text().splitlines()[:5]))
    assert faults(run(root, code=1)) == [("count", "cecum_t1_a", None)]
    assert run(root, "data.allow_missing=true")["notes"] == 1


def test_folders_without_frames_are_noted_or_missed(root: Path) -> None:
    (root / "calibration").mkdir()
    facts = run(root)
    assert [(f["video"], f["fault"]) for f in facts["findings"]] == [("calibration", False)]
    shutil.rmtree(root / "trans_t1_a")
    (root / "trans_t1_a").mkdir()
    assert faults(run(root, code=1)) == [("count", "trans_t1_a", None)]


def test_a_phantom_of_other_options_is_refused(root: Path) -> None:
    given = composed("verify", "data=phantom", "phantom=smoke", f"data.root={root}")
    with refused(DataError, None, "phantom.size=[108,135] phantom.frames_per_video=6"):
        verify(given)


def test_nothing_to_check_is_refused(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with refused(UserError, f"data.root={tmp_path / 'empty'}", "NNNN_color.png"):
        verify(composed("verify", "data=c3vd", f"data.root={tmp_path / 'empty'}"))
    with refused(DataError, f"data.root={tmp_path / 'none'}"):
        verify(composed("verify", "data=c3vd", f"data.root={tmp_path / 'none'}"))
    with refused(UserError, "data.test, data.also"):
        verify(composed("verify", f"data.root={tmp_path}", "data.also={}") | {"data": with_test(tmp_path)})


def with_test(root: Path) -> dict[str, Any]:
    data: dict[str, Any] = composed("verify", f"data.root={root}")["data"]
    source = {name: data[name] for name in ("name", "root", "release", "normals", "split", "allow_missing")}
    return {**data, "test": source}


def test_counts_of_c3vd_are_those_of_its_table(rendered: Path, tmp_path: Path) -> None:
    """At full size, so that two frames are all there are."""
    root = tmp_path / "c3vd"
    settings = PhantomSettings(size_hw=(1080, 1350), frames_per_video=2, videos=("desc_t4_a",))
    render_phantom(root, settings, workers=1, progress=False)
    given = composed("verify", "data=c3vd", f"data.root={root}", f"output={tmp_path / 'out'}", "workers=1")
    with pytest.raises(SystemExit):
        verify(given)
    facts = json.loads((tmp_path / "out" / "verify.json").read_text())
    assert facts["videos"][0]["expected"] == 148
    rules = [rule for rule, _, _ in faults(facts)]
    assert (rules.count("missing"), rules.count("count")) == (20, 1)
    assert set(rules) == {"missing", "count"}


def test_damaged_stores_are_faults(root: Path) -> None:
    store = root.parent / "elsewhere"
    camera = phantom_camera(PhantomSettings(size_hw=(108, 135)))
    recipe = Recipe("phantom", (64, 80), "stored", 100.0, camera.resized((64, 80)))
    for video in VIDEOS:
        write_video(store, Resized(C3VD(root, [video], camera=camera), (64, 80)), recipe, lambda: None)
    assert remember(root, store)
    facts = run(root)
    (note,) = [f for f in facts["findings"] if f["rule"] == "store"]
    assert not note["fault"]
    assert f"{store}: " in note["text"]
    values = np.lib.format.open_memmap(store / "cecum_t1_a" / "image.npy", mode="r+")
    values[0, 0, 30, 40] ^= 1
    values.flush()
    assert faults(run(root, code=1)) == [("store", "", None)]
    assert faults(run(root, "data.store=none")) == []
    assert faults(run(root, f"data.store={root.parent / 'nowhere'}", code=1)) == [("store", "", None)]


def test_the_command_line(root: Path) -> None:
    place = (*PHANTOM, *SPLIT, f"data.root={root}")
    answer = call("verify", *place, "--fast", "workers=1", cwd=root.parent)
    assert answer.returncode == 0, answer.stderr
    written = root.parent / "runs" / "verify_phantom" / "verify.json"
    assert json.loads(written.read_text())["fast"] is True
    (root / "cecum_t1_a" / "0003_depth.tiff").write_bytes(b"II*\0 nonsense")
    answer = call("verify", *place, "workers=2", "output=out", cwd=root.parent)
    assert answer.returncode == 1
    assert "Traceback" not in answer.stderr + answer.stdout
    assert "0003_depth.tiff: not a readable image" in answer.stdout
    answer = call("verify", *place, "data.rot=x", cwd=root.parent)
    assert (answer.returncode, len(answer.stderr.splitlines())) == (2, 1)


@pytest.mark.parametrize("folder", ["sample_current", "sample_pre_2023_05"])
def test_real_frames(folder: str, tmp_path: Path) -> None:
    given = composed(
        "verify",
        "data=c3vd",
        f"data.root={real_frames(folder)}",
        "data.allow_missing=true",
        f"output={tmp_path}",
        "workers=1",
    )
    if folder == "sample_current":  # the released normals of cecum_t1_a were not to be had
        with pytest.raises(SystemExit):
            verify(given)
    else:
        verify(given)
    facts = json.loads((tmp_path / "verify.json").read_text())
    found = {video["video"]: video for video in facts["videos"]}
    assert found["unknown_frame"]["release"] == folder.removeprefix("sample_")
    assert found["unknown_frame"]["camera"] == "lens"
    assert found["unknown_frame"]["angle"] < 2.5
    if folder == "sample_current":
        assert faults(facts) == [("pair", "cecum_t1_a", None)]
        assert found["cecum_t1_a"]["reprojection"] < 0.045
        assert found["cecum_t1_a"]["expected"] == 276
