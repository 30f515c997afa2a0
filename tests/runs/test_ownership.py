"""Nothing of others is replaced or deleted, whatever a command is pointed at."""

import shutil
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import onnx
import pytest
import torch
from fake_runs import write_run
from refusals import refusal, refused
from tiny_run import composed, earlier_export

from col3d.data.cache.prepare import prepare
from col3d.data.checks.verify import verify
from col3d.errors import DataError, UserError
from col3d.evaluation.evaluate import evaluate
from col3d.inference.export.export import export
from col3d.inference.export.exported import is_exported
from col3d.inference.predict import predict
from col3d.io.ownership import Owned
from col3d.reports.__main__ import main as report
from col3d.runs.folder import FILES
from col3d.training.train import train

pytestmark = pytest.mark.end_to_end

VIDEOS = ("desc_t4_a_s1",)
Compose = Callable[..., dict[str, Any]]


def kept(folder: Path) -> dict[Path, bytes]:
    """Every file below a folder."""
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def put(path: Path, content: str = "precious") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(content)
    return path


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    """Where files of others lie; all are there at the end as they were put."""
    place = tmp_path / "run"
    yield place
    assert all(path.read_text().startswith("precious") for path in place.rglob("*") if path.is_file())


@pytest.mark.parametrize("overwrite", ["true", "false"])
@pytest.mark.parametrize("name", [*FILES, "checkpoints/epoch=12.ckpt", "predictions_test/mine.npz"])
def test_a_training_replaces_no_file_of_others(
    name: str, overwrite: str, folder: Path, tiny: Compose
) -> None:
    put(folder / name)
    put(folder / "notes.txt")
    with refused(UserError, None, folder):
        train(tiny(f"overwrite={overwrite}", "callbacks.predictions=true"))


def test_a_lightning_run_of_others_is_left_alone(folder: Path, tiny: Compose) -> None:
    put(folder / "config.yaml", "precious: true")
    put(folder / "checkpoints" / "epoch=12.ckpt")
    for overrides in ([], ["overwrite=true"]):
        with refused(UserError, None, f"{folder} holds config.yaml"):
            train(tiny(*overrides))


def test_what_was_put_into_a_run_survives_its_replacement(tiny: Compose, tmp_path: Path) -> None:
    run = tmp_path / "run"
    train(tiny("callbacks.predictions=true"))
    mine = [
        put(run / name)
        for name in (
            "panels/mine.png",
            "checkpoints/epoch=12.ckpt",
            "predictions_test/mine.npz",
            "notes/a.md",
            ".lock",
        )
    ]
    before = kept(run)
    with refused(UserError, None, run, "another seed"):
        train(tiny("seed=1"))
    assert kept(run) == before
    train(tiny("seed=1", "overwrite=true"))
    assert all(path.read_text() == "precious" for path in mine)
    assert not (run / "predictions_test" / "index.json").exists()
    assert (run / "result.json").is_file()


def test_an_evaluation_replaces_nothing_but_evaluations(tiny_checkpoint: Path, tmp_path: Path) -> None:
    run = Path(shutil.copytree(tiny_checkpoint.parents[1], tmp_path / "trained"))
    given = [f"checkpoint={run / 'checkpoints' / 'best.ckpt'}", "accelerator=cpu", "panels=1"]
    before = kept(run)
    with refused(UserError, "output_dir", f"{run} holds summary.json"):
        evaluate(composed("evaluate", *given, f"output_dir={run}"))
    assert kept(run) == before
    place = tmp_path / "scored"
    mine = put(place / "panels" / "mine.png")
    for _ in range(2):
        evaluate(composed("evaluate", *given, f"output_dir={place}"))
        assert mine.read_text() == "precious"
        assert (place / "summary.json").is_file()
        assert len(list((place / "panels").glob("*.png"))) == 2
    for name in ("summary.json", "per_frame.csv", "run.html"):
        other = put(tmp_path / name / name)
        with refused(UserError, "output_dir", f"{other.parent} holds {name}"):
            evaluate(composed("evaluate", *given, f"output_dir={other.parent}"))
        assert other.read_text() == "precious"


def test_predictions_of_others_beside_a_checkpoint_stay(tiny_checkpoint: Path, tmp_path: Path) -> None:
    checkpoint = Path(shutil.copy(tiny_checkpoint, tmp_path / "best.ckpt"))
    mine = put(tmp_path / "predictions_test" / "index.json", '{"mine": "precious"}')
    place = ("accelerator=cpu", "panels=0", "keep_predictions=true")
    with refused(UserError, None, f"{mine.parent} holds index.json"):
        evaluate(composed("evaluate", f"checkpoint={checkpoint}", *place))
    assert "precious" in mine.read_text()


def test_a_report_replaces_nothing_but_reports(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_run(tmp_path / "runs" / "a")
    write_run(tmp_path / "runs" / "b", "newcrfs")
    paper, arguments = tmp_path / "paper", [str(tmp_path / "runs"), str(tmp_path / "paper")]
    mine = [put(paper / "tables" / f"mine.{ending}") for ending in ("md", "tex", "csv")]
    mine.append(put(paper / "figures" / "mine.png"))
    assert report(arguments) == 0
    first = set((paper / "tables").iterdir())
    shutil.rmtree(tmp_path / "runs" / "b")
    assert report(arguments) == 0
    assert set((paper / "tables").iterdir()) < first  # those of before that are none of this report's
    assert all(path.read_text() == "precious" for path in mine)
    table = next(path.name for path in (paper / "tables").iterdir() if path.stem != "mine")
    for name in ("report.md", "report.html", f"tables/{table}", "figures/per_video.png", "tables"):
        place = tmp_path / name.replace("/", "_")
        other = put(place / name)
        assert report([arguments[0], str(place)]) == 2, name
        complaint = refusal(capsys.readouterr().err)
        assert complaint.about == "OUT"
        assert f"{place} holds {name}" in complaint.message
        assert kept(place) == {other: b"precious"}


def test_a_prediction_replaces_no_file_of_others_and_no_input(
    tiny_checkpoint: Path, phantom_root: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"

    def predicted(given: Path, *overrides: str) -> None:
        options = (f"checkpoint={tiny_checkpoint}", "accelerator=cpu", "previews=true", "video=true")
        predict(composed("predict", *options, f"input={given}", f"output={out}", *overrides))

    (out / "frames").mkdir(parents=True)  # as of a prediction whose disk was full before its first frame
    predicted(phantom_root / "desc_t4_a")
    mine = [put(out / name) for name in ("frames/mine_depth.tiff", "previews/mine.png", "mine.csv")]
    before = kept(out)
    for given in (
        out / "*" / "0000.png",
        out / "previews",
        out / "side_by_side.mp4",
        out / "**" / "*.png",
        out,
    ):
        with refused(UserError, "output", f"{out} holds the input"):
            predicted(given, "overwrite=true")
        assert kept(out) == before
    predicted(phantom_root / "trans_t1_a", "overwrite=true", "files=false")
    assert all(path.read_text() == "precious" for path in mine)
    assert not (out / "frames" / "0000_depth.tiff").exists()


def test_a_verification_replaces_no_file_of_others(rendered: Path, tmp_path: Path) -> None:
    options = ("data=phantom", "phantom.size=[64,80]", "phantom.frames_per_video=3", "data/split=custom")
    parts = [f"data.split.{part}=[desc_t4_a]" for part in ("train", "val", "test")]

    def verified(out: Path) -> None:
        place = (f"data.root={rendered.parent}", f"output={out}", "workers=1", "data.allow_missing=true")
        with suppress(SystemExit):  # three frames are fewer than a video should have
            verify(composed("verify", *options, *parts, *place))
        assert (out / "verify.html").is_file()

    for name in ("verify.json", "verify.html"):
        mine = put(tmp_path / name / name)
        with refused(UserError, "output", f"{mine.parent} holds {name}"):
            verified(mine.parent)
        assert mine.read_text() == "precious"
    beside = put(tmp_path / "out" / "mine.html")
    for _ in range(2):
        verified(tmp_path / "out")
    (tmp_path / "out" / ".col3d_verification").unlink()  # as of before there were lists
    verified(tmp_path / "out")
    assert beside.read_text() == "precious"


def test_what_was_put_into_a_video_is_never_lost(tmp_path: Path) -> None:
    root, store = tmp_path / "frames", tmp_path / "store"
    parts = [f"data.split.{part}=[{video}]" for part in ("train", "val", "test") for video in VIDEOS[:1]]
    sizes = ("data.size=[64,80]", "phantom.size=[64,80]", "phantom.frames_per_video=2", "workers=1")
    given = composed(
        *("prepare", "data/split=custom", *parts, *sizes, f"data.root={root}", f"prepare.out={store}")
    )
    prepare(given)
    damaged = root / VIDEOS[0] / "0001_depth.tiff"
    for video, spoiled in ((root / VIDEOS[0], damaged), (store / VIDEOS[0], store / VIDEOS[0] / "mask.npy")):
        mine = put(video / "mine.csv")
        prepare(given)  # nothing is made anew
        spoiled.unlink()
        before = kept(tmp_path)
        with refused(DataError, None, f"{video} holds mine.csv"):
            prepare(given)
        assert kept(tmp_path) == before
        mine.unlink()
        prepare(given)
        assert spoiled.is_file()


def test_an_export_replaces_no_input(tiny_checkpoint: Path, tmp_path: Path) -> None:
    for ending in ("ckpt", "pt2", "onnx"):
        checkpoint = Path(shutil.copy(tiny_checkpoint, tmp_path / f"weights.{ending}"))
        with refused(UserError, "output", f"{checkpoint} is the checkpoint"):
            export(composed("export", f"checkpoint={checkpoint}", f"output={checkpoint}", "overwrite=true"))


@pytest.mark.parametrize("ending", ["ckpt", "pt2", "onnx"])
def test_an_export_replaces_exports_alone(ending: str, tiny_checkpoint: Path, tmp_path: Path) -> None:
    output = tmp_path / f"net.{ending}"

    def exported(*overrides: str) -> None:
        export(composed("export", f"checkpoint={tiny_checkpoint}", f"output={output}", *overrides))

    for content in (b"precious", b"", b"PK precious", theirs(ending, tmp_path), tiny_checkpoint.read_bytes()):
        output.write_bytes(content)
        with refused(UserError, "output", f"{output} is no export"):
            exported("overwrite=true")
        assert output.read_bytes() == content
    earlier_export(output)
    assert is_exported(output)
    if ending == "ckpt":  # the others are traced, in tests of their own
        exported("overwrite=true")
        exported("overwrite=true")


def theirs(ending: str, folder: Path) -> bytes:
    """A file of the same format by another program."""
    if ending == "onnx":
        value = onnx.helper.make_tensor_value_info("x", onnx.TensorProto.FLOAT, [1])
        node = onnx.helper.make_node("Identity", ["x"], ["y"])
        given = onnx.helper.make_tensor_value_info("y", onnx.TensorProto.FLOAT, [1])
        graph = onnx.helper.make_graph([node], "g", [value], [given])
        return bytes(onnx.helper.make_model(graph, producer_name="pytorch").SerializeToString())
    if ending == "pt2":
        torch.export.save(torch.export.export(torch.nn.Identity(), (torch.ones(1),)), folder / "other.pt2")
        return (folder / "other.pt2").read_bytes()
    torch.save({"state_dict": {"a": torch.ones(1)}}, folder / "other.pt")
    return (folder / "other.pt").read_bytes()


def test_a_list_owns_nothing_outside_its_folder(tmp_path: Path) -> None:
    mine = put(tmp_path / "mine.txt")
    place = tmp_path / "place"
    put(place / ".col3d_report", f'"../mine.txt"\n"{mine}"\n"a.md"\nnot json\n"cut of')
    owned = Owned(place, "report", "OUT")
    assert list(owned.names) == ["a.md"]
    owned.adopt("b.md")
    assert list(Owned(place, "report", "OUT").names) == ["a.md", "b.md"]
    put(place / "b.md")
    owned.remove()
    assert mine.read_text() == "precious"
    assert not (place / "b.md").exists()
