"""The notebooks run, made small, and say sane things; they are kept without outputs, and define nothing."""

import ast
import base64
import io
import os
import re
from pathlib import Path

import nbformat
import numpy as np
import pytest
from nbclient import NotebookClient
from PIL import Image
from tiny_options import SMALL, SMALLEST

pytestmark = pytest.mark.end_to_end

FOLDER = Path(__file__).parents[2] / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
SECONDS = 300
TINY = [SMALL, *SMALLEST]
PARAMETERS = {
    "1_look_at_a_frame": "SIZE = (108, 135)",
    "2_camera_and_rays": "SIZE = (108, 135)",
    "3_train_in_five_minutes": f'PRESET, EPOCHS, OPTIONS = "smoke", 1, {TINY}',
    "4_read_a_benchmark": f"SEEDS, EPOCHS, OPTIONS = [0], 1, {TINY}",
}
"""What takes the place of a notebook's parameters."""
FIGURES = {
    "1_look_at_a_frame": 5,
    "2_camera_and_rays": 6,
    "3_train_in_five_minutes": 4,
    "4_read_a_benchmark": 4,
}
"""How many there are at least: real frames add theirs."""


def read(path: Path) -> nbformat.NotebookNode:
    return nbformat.read(path, as_version=4)


def code(notebook: nbformat.NotebookNode) -> list[nbformat.NotebookNode]:
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def outputs(notebook: nbformat.NotebookNode, kind: str) -> list[str]:
    """Of one MIME type; `stdout` and `stderr` are streams."""
    found = [output for cell in code(notebook) for output in cell.outputs]
    if kind in ("stdout", "stderr"):
        return [output.text for output in found if output.output_type == "stream" and output.name == kind]
    return [output.data[kind] for output in found if kind in output.get("data", {})]


def environment(folder: Path) -> dict[str, str]:
    """One thread, files of the notebooks and of IPython in a folder, and no trace of pytest."""
    kept = {
        name: value for name, value in os.environ.items() if not name.startswith(("PYTEST_", "MPLBACKEND"))
    }
    if sample := kept.get("COL3D_C3VD_SAMPLE"):
        kept["COL3D_C3VD_SAMPLE"] = str(Path(sample).absolute())  # notebooks run in a folder of their own
    own = {"COL3D_NOTEBOOK_DIR": str(folder), "IPYTHONDIR": str(folder / "ipython"), "OMP_NUM_THREADS": "1"}
    return {**kept, **own}


def executed(path: Path, folder: Path) -> nbformat.NotebookNode:
    """The notebook with its outputs, run by this interpreter with small parameters."""
    notebook = read(path)
    (parameters,) = (cell for cell in code(notebook) if "parameters" in cell.metadata.get("tags", ()))
    parameters.source += "\n" + PARAMETERS[path.stem]
    client = NotebookClient(notebook, timeout=SECONDS, resources={"metadata": {"path": str(FOLDER)}})
    client.execute(env=environment(folder))
    return notebook


def numbers(pattern: str, text: str) -> list[float]:
    """What the groups of a pattern match, of the first place where it does."""
    match = re.search(pattern, text)
    assert match, f"{pattern} is not in:\n{text}"
    return [float(group) for group in match.groups()]


def check_frame(text: str) -> None:
    assert "{'trans_t3_b': 'current'} and {'trans_t3_b': 'pre_2023_05'}" in text
    for release, other in (("current", "pre_2023_05"), ("pre_2023_05", "current")):
        (right,) = numbers(rf"stored as {release} +read as {release} *: +([\d.]+) degrees", text)
        (wrong,) = numbers(rf"stored as {release} +read as {other} *: +([\d.]+) degrees", text)
        assert right < 3
        assert wrong > 25
    median, largest = numbers(r"differ by ([\d.]+) degrees \(median\),\n([\d.]+) at most", text)
    assert median < 0.01
    assert largest < 1
    assert numbers(r"known +([\d.]+)%", text)[0] > 80
    assert "do not follow data.release=current" in text


def check_camera(text: str) -> None:
    assert 70 < numbers(r"true lens: rays reach ([\d.]+) degrees", text)[0] < 75
    assert 40 < numbers(r"pinhole: rays reach ([\d.]+) degrees", text)[0] < 47
    assert numbers(r"plane, head-on.* ([\d.]+) degrees \(median\)", text)[0] < 0.1
    assert numbers(r"tube of radius.* ([\d.]+) degrees \(median\)", text)[0] > 10
    lens, pinhole = numbers(
        r"phantom +true lens: +([\d.]+) degrees.*\n.*phantom +pinhole +: +([\d.]+) degrees", text
    )
    assert lens < 2
    assert pinhole > 10
    if "COL3D_C3VD_SAMPLE" in os.environ:
        lens, pinhole = numbers(
            r"real frame true lens: +([\d.]+) degrees.*\n.*real frame pinhole +: +([\d.]+)", text
        )
        assert (lens, pinhole) == pytest.approx((2.0, 21.6), abs=0.1)  # as README and docs/concepts.md say
    assert 5 < numbers(r"phantom +n_z > 0 on ([\d.]+)%", text)[0] < 50
    resized, unshifted, unmoved = numbers(
        r"camera resized +: +([\d.]+).*\n.*half pixel *: +([\d.]+).*\n.*not moved +: +([\d.]+)", text
    )
    assert resized < unshifted < unmoved
    assert numbers(r"mirrored rays: ([\d.e+-]+) apart", text)[0] < 1e-5


def check_training(text: str) -> None:
    assert "epoch 1/1" in text
    assert "checkpoints/best.ckpt" in text
    assert "col3d_mtl, trained on phantom, sees (64, 80) pixels" in text
    assert "this lens: True" in text
    assert "'depth': (1, 1, 270, 338), 'normals': (1, 3, 270, 338)" in text
    learnt, constant = numbers(r"AbsRel ([\d.]+), against ([\d.]+)", text)
    predicted, scaled, ratio = numbers(
        r"AbsRel ([\d.]+) as predicted, ([\d.]+) when multiplied by ([\d.]+)", text
    )
    assert min(learnt, constant, predicted, scaled, ratio) > 0.01


def check_benchmark(text: str) -> None:
    for name in ("bts_seed0 ", "bts_seed0/evaluation_test_median_scaled ", "bts_cbam_mtl_seed0 "):
        assert re.search(rf"^{name}", text, flags=re.MULTILINE), name
    assert "left out: " not in text
    interval = r"mean ([\d.]+), 95 % interval by drawing {} +([\d.]+) to ([\d.]+)"
    for drawn in ("frames", "videos"):
        mean, low, high = numbers(interval.format(drawn), text)
        assert low <= mean <= high
    mean, pairs, low, high = numbers(
        r"less bts: ([+-][\d.]+) AbsRel on (\d+) pairs of frames,\n.*: ([+-][\d.]+) to ([+-][\d.]+)", text
    )
    assert pairs == 4
    assert low <= mean <= high
    over_frames, over_videos = numbers(r"mean over frames ([\d.]+), over videos ([\d.]+)", text)
    assert over_frames != over_videos
    standard, scaled = numbers(r"bts +Abs Rel +standard +([\d.]+), median_scaled +([\d.]+)", text)
    assert standard != scaled


CHECKS = {
    "1_look_at_a_frame": check_frame,
    "2_camera_and_rays": check_camera,
    "3_train_in_five_minutes": check_training,
    "4_read_a_benchmark": check_benchmark,
}


def test_every_notebook_is_checked() -> None:
    assert [path.stem for path in NOTEBOOKS] == sorted(CHECKS)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_it_runs_and_says_sane_things(path: Path, tmp_path: Path) -> None:
    notebook = executed(path, tmp_path)
    assert outputs(notebook, "stderr") == []
    figures = [Image.open(io.BytesIO(base64.b64decode(png))) for png in outputs(notebook, "image/png")]
    assert len(figures) >= FIGURES[path.stem]
    assert all(np.asarray(figure.convert("L")).std() > 10 for figure in figures)  # something is drawn
    CHECKS[path.stem]("".join(outputs(notebook, "stdout")))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_it_is_stripped(path: Path) -> None:
    notebook = read(path)
    nbformat.validate(notebook)
    assert notebook.metadata.kernelspec.name == "python3"
    assert [cell.execution_count for cell in code(notebook)] == [None] * len(code(notebook))
    assert [cell.outputs for cell in code(notebook)] == [[]] * len(code(notebook))
    assert path.stat().st_size < 40_000


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_it_defines_nothing(path: Path) -> None:
    nodes = [node for cell in code(read(path)) for node in ast.walk(ast.parse(cell.source))]
    defining = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef, ast.Lambda)
    assert [ast.unparse(node) for node in nodes if isinstance(node, defining)] == []
    modules = {node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)}
    assert any(module.startswith("col3d.") for module in modules)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_its_links_lead_somewhere(path: Path) -> None:
    text = "\n".join(cell.source for cell in read(path).cells if cell.cell_type == "markdown")
    targets = re.findall(r"\]\(([^)\s#]+)", text)
    assert targets or path == NOTEBOOKS[-1]
    assert [target for target in targets if not (FOLDER / target).is_file()] == []
