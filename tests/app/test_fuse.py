"""A video of the phantom becomes a surface; its own truth is on it, and a wrong depth is not."""

import json
import shutil
from pathlib import Path

import pytest
from tiny_run import composed

from col3d.app.fuse import fuse
from col3d.checks import UserError
from col3d.fusion import Surface
from col3d.fusion.coverage import read_coverage

pytestmark = pytest.mark.filterwarnings("ignore:.*pin_memory.*")


def fused(video: Path, folder: Path, *overrides: str) -> dict[str, object]:
    place = (f"video={video}", f"output={folder}", "voxel=2", "size=[64,80]", "accelerator=cpu")
    fuse(composed("fuse", *place, *overrides))
    content: dict[str, object] = json.loads((folder / "fusion.json").read_text())
    return content


def test_truth_and_prediction_of_a_video(
    phantom_root: Path, tiny_checkpoint: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    video = phantom_root / "desc_t4_a"
    alone = fused(video, tmp_path / "alone")
    assert (alone["frames"], alone["comparisons"]) == (3, {})
    assert "nothing to compare with" in capsys.readouterr().out
    both = fused(video, tmp_path / "both", f"checkpoint={tiny_checkpoint}", "size=null", "scale=median")
    errors = both["comparisons"]["prediction to fused truth"]  # type: ignore[index]
    assert errors["accuracy_mean_mm"] > 0.5
    assert both["scale"] != 1.0
    assert {path.name for path in (tmp_path / "both").iterdir()} == {
        *("truth.ply", "predicted.ply", "error.ply", "fusion.json", "fusion.html")
    }
    with pytest.raises(UserError, match="holds a fusion already"):
        fused(video, tmp_path / "alone")


def test_the_mesh_of_the_data_set_is_compared_with(phantom_root: Path, tmp_path: Path) -> None:
    video = tmp_path / "C3VD" / "desc_t4_a"
    shutil.copytree(phantom_root / "desc_t4_a", video)
    fused(video, tmp_path / "first")
    import trimesh

    mesh = trimesh.load(tmp_path / "first" / "truth.ply")
    lines = [f"v {x} {y} {z}" for x, y, z in mesh.vertices]
    lines += ["usemtl seen_0", *(f"f {a + 1} {b + 1} {c + 1}" for a, b, c in mesh.faces)]
    far_away = len(mesh.vertices)
    lines += ["v 900 900 900", "v 901 900 900", "v 900 901 900", "usemtl unseen_1"]
    lines += [f"f {far_away + 1}//1 {far_away + 2}//1 {far_away + 3}//1"]
    (video / "coverage_mesh.obj").write_text("\n".join(lines))
    found = fused(video, tmp_path / "second")["comparisons"]["truth to coverage_mesh.obj"]  # type: ignore[index]
    assert found["accuracy_mean_mm"] < 1e-3
    assert found["completeness_mean_mm"] < 1e-3
    whole, seen = read_coverage(video / "coverage_mesh.obj")
    assert isinstance(whole, Surface)
    assert len(whole.triangles) == len(seen.triangles) + 1
    (video / "coverage_mesh.obj").write_text("f 1 2 3")
    with pytest.raises(UserError, match=r"coverage_mesh\.obj: not a mesh in OBJ format"):
        fused(video, tmp_path / "third")


def test_what_cannot_be_fused_is_refused(phantom_root: Path, tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"video: .* is no folder of NNNN_color\.png"):
        fused(tmp_path, tmp_path / "out")
    with pytest.raises(UserError, match="scale: is of predictions"):
        fused(phantom_root / "desc_t4_a", tmp_path / "out", "scale=median")
    video = tmp_path / "C3VD" / "desc_t4_a"
    shutil.copytree(phantom_root / "desc_t4_a", video)
    (video / "pose.txt").unlink()
    with pytest.raises(UserError, match=r"pose\.txt"):
        fused(video, tmp_path / "out")
