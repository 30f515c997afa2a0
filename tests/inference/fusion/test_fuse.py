"""A video of the phantom becomes a surface; its own truth is on it, and a wrong depth is not."""

import json
import shutil
from pathlib import Path

import pytest
from refusals import refused
from tiny_run import composed

from col3d.errors import UserError
from col3d.inference.fusion.fuse import fuse

pytestmark = pytest.mark.filterwarnings("ignore:.*pin_memory.*")

COVERAGE = "truth to coverage_mesh.obj"


def fused(video: Path, folder: Path, *overrides: str) -> dict[str, object]:
    place = (f"video={video}", f"output={folder}", "voxel=2", "size=[64,80]", "accelerator=cpu")
    fuse(composed("fuse", *place, *overrides))
    content: dict[str, object] = json.loads((folder / "fusion.json").read_text())
    return content


def test_truth_and_prediction_of_a_video(
    rendered: Path, tiny_checkpoint: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    truth = fused(rendered, tmp_path / "truth")["comparisons"]
    assert list(truth) == [COVERAGE]  # type: ignore[call-overload]
    assert truth[COVERAGE]["accuracy_mean_mm"] < 1  # type: ignore[index]
    video = Path(shutil.copytree(rendered, tmp_path / "C3VD" / "desc_t4_a"))
    (video / "coverage_mesh.obj").unlink()
    capsys.readouterr()
    alone = fused(video, tmp_path / "alone")
    assert (alone["frames"], alone["comparisons"]) == (3, {})
    assert "nothing to compare with" in capsys.readouterr().out
    both = fused(video, tmp_path / "both", f"checkpoint={tiny_checkpoint}", "size=null", "scale=median")
    errors = both["comparisons"]["prediction to fused truth"]  # type: ignore[index]
    assert errors["accuracy_mean_mm"] > 0.5
    assert both["scale"] != 1.0
    assert {path.name for path in (tmp_path / "both").glob("[!.]*")} == {
        *("truth.ply", "predicted.ply", "error.ply", "fusion.json", "fusion.html")
    }
    with refused(UserError, "output", f"{tmp_path / 'alone'} holds a fusion"):
        fused(video, tmp_path / "alone")


def test_the_mesh_of_the_data_set_is_compared_with(rendered: Path, tmp_path: Path) -> None:
    video = tmp_path / "C3VD" / "desc_t4_a"
    shutil.copytree(rendered, video)
    fused(video, tmp_path / "first")
    import trimesh

    mesh = trimesh.load(tmp_path / "first" / "truth.ply")
    lines = [f"v {x} {y} {z}" for x, y, z in mesh.vertices]
    lines += ["v 900 900 900", "v 901 900 900", "v 900 901 900", "vt 0.0 0.0", "vt 1.0 1.0"]
    lines += [f"f {a + 1}/1 {b + 1}/1 {c + 1}/1" for a, b, c in mesh.faces]
    far_away = len(mesh.vertices)
    lines += [f"f {far_away + 1}/2 {far_away + 2}/2 {far_away + 3}/2"]
    (video / "coverage_mesh.obj").write_text("\n".join(lines))
    found = fused(video, tmp_path / "second")["comparisons"]["truth to coverage_mesh.obj"]  # type: ignore[index]
    assert found["accuracy_mean_mm"] < 1e-3
    assert found["completeness_mean_mm"] < 1e-3
    (video / "coverage_mesh.obj").write_text("f 1 2 3")
    with refused(UserError, video / "coverage_mesh.obj", "OBJ"):
        fused(video, tmp_path / "third")


def test_what_cannot_be_fused_is_refused(rendered: Path, tmp_path: Path) -> None:
    with refused(UserError, "video", tmp_path, "NNNN_color.png"):
        fused(tmp_path, tmp_path / "out")
    with refused(UserError, "scale", "checkpoint=PATH"):
        fused(rendered, tmp_path / "out", "scale=median")
    video = tmp_path / "C3VD" / "desc_t4_a"
    shutil.copytree(rendered, video)
    (video / "pose.txt").unlink()
    with refused(UserError, video / "pose.txt", "no such file"):
        fused(video, tmp_path / "out")


def test_a_library_that_open3d_lacks_is_named(
    rendered: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(name: str) -> None:
        raise ImportError("libusb-1.0.so.0: cannot open shared object file")

    monkeypatch.setattr("col3d.inference.fusion.fuse.import_module", fails)
    with refused(UserError, None, "Open3D", "(libusb-1.0.so.0: ", "apt-get install libusb"):
        fused(rendered, tmp_path / "out")


def test_files_of_others_and_earlier_fusions_stay(rendered: Path, tmp_path: Path) -> None:
    (tmp_path / "truth.ply").write_text("mine")
    with refused(UserError, "output", f"{tmp_path} holds truth.ply,"):
        fused(rendered, tmp_path)
    assert (tmp_path / "truth.ply").read_text() == "mine"
    fused(rendered, tmp_path / "out")
    before = (tmp_path / "out" / "truth.ply").read_bytes()
    with refused(UserError, "video", rendered.with_name("absent"), "NNNN_color.png"):
        fused(rendered.with_name("absent"), tmp_path / "out", "overwrite=true")
    assert (tmp_path / "out" / "truth.ply").read_bytes() == before


def test_poses_that_are_none_are_refused(
    rendered: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    video = tmp_path / "C3VD" / "desc_t4_a"
    shutil.copytree(rendered, video)
    lines = (video / "pose.txt").read_text().splitlines()
    first = lines[0].split(",")
    stretched = ",".join(str(3 * float(n)) for n in first[:12]) + "," + ",".join(first[12:])
    broken = {
        "nan": ("line 2 ", [lines[0], ",".join(["nan", *first[1:]]), lines[2]]),
        "stretched": ("line 2 ", [lines[0], stretched]),
        "blank": ("line 1 ", ["", *lines]),
    }
    for name, (line, content) in broken.items():
        (video / "pose.txt").write_text("\n".join(content))
        with refused(UserError, video / "pose.txt", line):
            fused(video, tmp_path / name)
    (video / "pose.txt").write_text("\n".join(lines[:2]) + "\n\n")
    assert fused(video, tmp_path / "short")["frames"] == 2
    assert "1 of 3 frames have no line in pose.txt" in capsys.readouterr().out


def test_a_video_without_truth_is_fused_from_its_predictions(
    rendered: Path, tiny_checkpoint: Path, tmp_path: Path
) -> None:
    """As the deformation videos of C3VDv2: rgb/NNNN.png and pose.txt, no more."""
    video = tmp_path / "C3VDv2" / "c1_cecum_t1_v4"
    (video / "rgb").mkdir(parents=True)
    for path in (rendered).glob("*_color.png"):
        shutil.copy(path, video / "rgb" / f"{path.name.removesuffix('_color.png')}.png")
    shutil.copy(rendered / "pose.txt", video)
    found = fused(video, tmp_path / "out", f"checkpoint={tiny_checkpoint}", "size=null")
    assert (found["frames"], found["comparisons"]) == (3, {})
    assert {path.name for path in (tmp_path / "out").glob("[!.]*")} == {
        *("predicted.ply", "fusion.json", "fusion.html")
    }
    with refused(UserError, "video", video, "checkpoint=PATH"):
        fused(video, tmp_path / "none")
    with refused(UserError, "scale", "median", video):
        fused(
            video,
            tmp_path / "none",
            f"checkpoint={tiny_checkpoint}",
            "size=null",
            "scale=median",
        )
    with refused(UserError, "split entry 'c1_cecum_t1_v4'", "data=c3vdv2"):
        fused(video, tmp_path / "none", "dataset=c3vd", f"checkpoint={tiny_checkpoint}", "size=null")


def test_a_video_by_its_name_of_today(rendered: Path, tmp_path: Path) -> None:
    shutil.copytree(rendered, tmp_path / "C3VD" / "c0_descending_t4_v1")
    found = fused(tmp_path / "C3VD" / "c0_descending_t4_v1:0-1", tmp_path / "out")
    assert found["frames"] == 2
    assert list(found["comparisons"]) == [COVERAGE]  # type: ignore[call-overload]
