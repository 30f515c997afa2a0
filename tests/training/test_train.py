"""Whole runs, small: every model trains, everything is written, and the numbers agree with each other."""

import csv
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
import yaml
from programs import call
from refusals import refused
from tiny_run import SMALL, TINY, composed, real_frames

from col3d.errors import DataError, UserError
from col3d.evaluation.evaluate import evaluate
from col3d.geometry.camera_file import camera_from_plain
from col3d.layers.network import DepthNetwork
from col3d.losses import depth
from col3d.registry.metric_specs import OURS
from col3d.reports.paper_tables import methods
from col3d.reports.per_frame import means, read_per_frame
from col3d.training.callbacks.epoch_lines import EpochLines
from col3d.training.train import train

pytestmark = [pytest.mark.end_to_end, pytest.mark.filterwarnings("ignore:.*pin_memory.*")]
Compose = Callable[..., dict[str, Any]]
EVERY_WAY = [
    *("bts", "bts_cbam", "bts_cbam_mtl", "col3d_mtl", "newcrfs", "monodepth_fpn", "pix2pix"),
    *(f"{name} model.normals=unc loss=mtl_xtc" for name in ("bts", "bts_cbam", "newcrfs")),
    *(f"{name} model.normals=unc loss=mtl_xtc" for name in ("monodepth_fpn", "pix2pix")),
    *(
        f"{name} model.normals=unc model.normal_frame=ray loss=mtl_xtc"
        for name in ("bts", "col3d_mtl", "newcrfs", "pix2pix")
    ),
]


def score(checkpoint: Path, *overrides: str) -> None:
    evaluate(composed("evaluate", f"checkpoint={checkpoint}", "accelerator=cpu", "panels=0", *overrides))


@pytest.mark.parametrize("way", EVERY_WAY)
def test_every_model_trains_and_leaves_its_results(way: str, tiny: Compose, tmp_path: Path) -> None:
    model, *overrides = way.split()
    best = train(tiny(f"model={model}", *overrides))
    run = tmp_path / "run"
    rows = read_per_frame(run / "per_frame.csv")
    depth = {name for name, spec in OURS.items() if spec.task == "depth"}
    metrics = set(OURS) if "mtl" in way else depth
    assert [(row["video"], row["frame"]) for row in rows] == [
        *(("desc_t4_a", str(i)) for i in range(3)),
        ("trans_t1_a", "2"),
    ]
    assert {(row["model"], row["segment"], row["protocol"]) for row in rows} == {
        (model, "descending", "standard"),
        (model, "transverse", "standard"),
    }
    summary = json.loads((run / "summary.json").read_text())
    unseen = {name for name in OURS if name.startswith("far_")}  # no pixel is as far away
    assert set(summary["metrics"]) | unseen == metrics
    assert list(summary["metrics"]) == [name for name in OURS if name in summary["metrics"]]
    assert set(summary["metric_specs"]) == set(summary["metrics"])
    assert summary["metrics"] == pytest.approx(means(rows))
    assert summary["best"]["val/abs_rel"] == best
    assert set(summary["baseline"]) == {name for name in depth if OURS[name].in_validation}
    assert summary["label"] == methods()[model]
    assert summary["cost"]["gflop"] > 0.01
    assert summary["frames_by_split"] == {"train": 5, "val": 2, "test": 4}
    assert len(list((run / "panels").glob("*.png"))) == 1
    assert yaml.safe_load((run / "config.yaml").read_text())["model"]["name"] == model
    with (run / "metrics.csv").open() as file:
        columns = csv.DictReader(file).fieldnames or []
    assert {"train/loss", "val/loss", "val/abs_rel", "test/abs_rel", "train/loss_depth"} <= set(columns)
    assert ("train/loss_consistency" in columns) == ("xtc" in way or model == "col3d_mtl")
    assert ("train/loss_discriminator" in columns) == (model == "pix2pix")


def test_checkpoints_hold_plain_values_and_score_the_same_again(tiny: Compose, tmp_path: Path) -> None:
    train(tiny())
    run = tmp_path / "run"
    for name in ("best", "last"):
        content = torch.load(run / "checkpoints" / f"{name}.ckpt", weights_only=True)
        about, options = content["about"], content["hyper_parameters"]["options"]
        assert set(about["release"]) == {"cecum_t1_a", "trans_t1_a", "desc_t4_a"}
        assert set(about["release"].values()) == {"current"}
        assert [camera_from_plain(camera).size_hw for camera in about["cameras"]] == [(64, 80)]
        assert about["split"]["test"] == options["data"]["split"]["test"] == ["desc_t4_a", "trans_t1_a:2-2"]
        assert 0 < about["metrics"]["val/abs_rel"] < 100
        assert set(about["versions"]) >= {"torch", "lightning", "col3d"}
        assert "commit" in about
    checkpoint = run / "checkpoints" / "best.ckpt"
    score(checkpoint)
    assert (run / "evaluation_test" / "per_frame.csv").read_bytes() == (run / "per_frame.csv").read_bytes()
    score(checkpoint, f"output_dir={tmp_path / 'val'}", "split=val")
    summary = json.loads((tmp_path / "val" / "summary.json").read_text())
    before = json.loads((run / "summary.json").read_text())
    assert summary["metrics"]["abs_rel"] == pytest.approx(before["best"]["val/abs_rel"], rel=1e-5)


@pytest.mark.parametrize("protocol", ["standard", "published", "mirrored_ramp"])
def test_a_run_and_an_evaluation_under_several_protocols_agree_to_the_bit(
    protocol: str, tiny: Compose, tmp_path: Path
) -> None:
    train(tiny(f"protocol={protocol}", "data.batch_size=3"))
    several = ["standard", "native", "published", "mirrored_ramp"]
    score(
        tmp_path / "run" / "checkpoints" / "best.ckpt",
        f"protocol=[{','.join(several)}]",
        f"output_dir={tmp_path / 'scored'}",
        "keep_predictions=true",
        "workers=1",
    )
    tables = {name: (tmp_path / "scored" / name / "per_frame.csv").read_bytes() for name in several}
    assert tables[protocol] == (tmp_path / "run" / "per_frame.csv").read_bytes()
    assert len(set(tables.values())) == len(several)
    kept = {path.parent.name for path in (tmp_path / "run").glob("predictions_*/index.json")}
    assert kept == {"predictions_test", "predictions_test_ramp"}


def test_the_same_seed_gives_the_same_run_and_another_another(tiny: Compose, tmp_path: Path) -> None:
    scores = [
        train(tiny(f"seed={seed}", f"output_dir={tmp_path / name}"))
        for seed, name in ((1, "a"), (1, "b"), (2, "c"))
    ]
    assert scores[0] == scores[1] != scores[2]


def test_a_finished_run_is_kept(tiny: Compose, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first = train(tiny())
    written = (tmp_path / "run" / "summary.json").stat().st_mtime_ns
    assert train(tiny()) == first
    assert "finished before" in capsys.readouterr().out
    assert (tmp_path / "run" / "summary.json").stat().st_mtime_ns == written
    assert train(tiny("data.workers=1")) == first
    with refused(UserError, None, tmp_path / "run", "another seed", "overwrite=true"):
        train(tiny("seed=3"))
    with pytest.raises(DataError):
        train(tiny("seed=3", "overwrite=true", "data.split.test=[desc_t4_a:50-60]"))
    assert (tmp_path / "run" / "checkpoints" / "best.ckpt").is_file()
    train(tiny("seed=3", "overwrite=true"))
    assert (tmp_path / "run" / "summary.json").stat().st_mtime_ns > written


def test_a_folder_of_something_else_is_left_alone(tiny: Compose, tmp_path: Path) -> None:
    mine = tmp_path / "run" / "checkpoints" / "mine.pt"
    mine.parent.mkdir(parents=True)
    mine.write_text("precious")
    with refused(UserError, None, tmp_path / "run", "checkpoints"):
        train(tiny("overwrite=true"))
    assert mine.read_text() == "precious"


def test_what_is_no_checkpoint_of_ours_is_refused(tiny: Compose, tmp_path: Path) -> None:
    class Payload:
        def __reduce__(self) -> Any:
            return (Path.touch, (tmp_path / "executed",))

    options = tiny()
    contents = [b"", b"PK", b"a: [1]", Payload(), torch.zeros(3), {"state_dict": {}}, [1], options]
    ours = {"hyper_parameters": {"options": {**options, "output_dir": "x"}}}
    contents += [{"hyper_parameters": {"options": "hi"}}, ours, {**ours, "state_dict": {"a": torch.zeros(1)}}]
    path = tmp_path / "some.ckpt"
    for content in contents:
        path.write_bytes(content) if isinstance(content, bytes) else torch.save(content, path)
        with refused(UserError, "checkpoint", path):
            score(path, f"output_dir={tmp_path / 'out'}")
    assert not (tmp_path / "executed").exists()


def test_bfloat16_and_pinhole_geometry_step(tiny: Compose) -> None:
    other = ("loss.terms.consistency.geometry=pinhole", "loss.terms.normals.term=normal_rmse")
    assert 0 < train(tiny("trainer.precision=bf16-mixed", *other)) < 100


def test_two_processes_score_each_frame_once(tiny: Compose, tmp_path: Path) -> None:
    """Lightning starts the second process by the command line, so this runs train.py as a user does."""
    overrides = ["trainer=ddp", "trainer.devices=2", "trainer.accelerator=cpu"]
    options = tiny()
    root, split = options["data"]["root"], options["data"]["split"]
    folder = tmp_path / "ddp"
    arguments = [*TINY, *overrides, f"data.root={root}", f"hydra.run.dir={folder}"]
    train(options)
    answer = call("train.py", *arguments, cwd=tmp_path)
    assert answer.returncode == 0, answer.stderr
    found = [json.loads((run / "summary.json").read_text())["baseline"] for run in (tmp_path / "run", folder)]
    baselines = [{name: value for name, value in of_run.items() if name in OURS} for of_run in found]
    assert baselines[0] == pytest.approx(baselines[1], rel=0.2)  # the doubled step pads five frames to six
    alone = read_per_frame(tmp_path / "run" / "per_frame.csv")
    both = read_per_frame(folder / "per_frame.csv")
    assert [(row["video"], row["frame"]) for row in both] == [(row["video"], row["frame"]) for row in alone]
    assert split["name"] == "custom"


def test_weights_and_biases_offline(tiny: Compose, tmp_path: Path) -> None:
    train(tiny("logger=wandb"))
    runs = list((tmp_path / "run" / "wandb").glob("offline-run-*"))
    assert len(runs) == 1
    assert list(runs[0].glob("*.wandb"))
    import wandb

    assert wandb.run is None


def test_a_diverging_run_names_step_and_frames(
    tiny: Compose, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(depth, "silog", lambda preds, target, mask: preds.sum() * float("nan"))
    with refused(UserError, None, "nan", "loss_depth", "step 0", "frames ", "optimizer.lr"):
        train(tiny("model=bts"))
    assert not list((tmp_path / "run").rglob("*.ckpt"))


def test_a_run_that_was_cut_off_goes_on_to_the_same_weights(
    tiny: Compose, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def weights(folder: str) -> dict[str, torch.Tensor]:
        path = tmp_path / folder / "checkpoints" / "last.ckpt"
        state: dict[str, torch.Tensor] = torch.load(path, weights_only=True)["state_dict"]
        return state

    def columns(folder: str) -> list[str]:
        with (tmp_path / folder / "metrics.csv").open() as file:
            return [row["train/loss"] for row in csv.DictReader(file) if row["train/loss"]]

    def options(folder: str) -> dict[str, Any]:
        return tiny("trainer.max_epochs=3", f"output_dir={tmp_path / folder}")

    class PowerCutError(Exception):
        pass

    def cut(self: EpochLines, trainer: Any, pl_module: Any) -> None:
        if trainer.current_epoch == 1:
            raise PowerCutError

    train(options("whole"))
    with monkeypatch.context() as patched:
        patched.setattr(EpochLines, "on_train_epoch_end", cut)
        with pytest.raises(PowerCutError):
            train(options("cut"))
    checkpoints = tmp_path / "cut" / "checkpoints"
    (checkpoints / "best.ckpt").write_bytes((checkpoints / "last.ckpt").read_bytes())
    (checkpoints / "last.ckpt").write_bytes(
        (checkpoints / "best.ckpt").read_bytes()[:5000]
    )  # cut while saving
    assert not (tmp_path / "cut" / "summary.json").exists()
    train(options("cut"))
    whole, continued = weights("whole"), weights("cut")
    assert all(torch.equal(whole[name], continued[name]) for name in whole)
    assert columns("cut") == columns("whole")
    assert len(columns("whole")) == 3


def test_the_last_checkpoint_is_of_the_last_epoch_whichever_was_best(tiny: Compose, tmp_path: Path) -> None:
    worse = ["model=bts", "optimizer=sgd", "optimizer.lr=0.03", "scheduler=constant", "trainer.max_epochs=3"]
    train(tiny(*worse))
    run = tmp_path / "run"
    epochs = {
        name: torch.load(run / "checkpoints" / f"{name}.ckpt", weights_only=True)["epoch"]
        for name in ("best", "last")
    }
    assert epochs["last"] == 2
    assert epochs["best"] < 2


def test_a_file_that_spoils_is_one_line_even_from_a_worker(tiny: Compose, tmp_path: Path) -> None:
    train(tiny())
    root = Path(tiny()["data"]["root"])
    shutil.copytree(root, tmp_path / "copy")
    spoilt = tmp_path / "copy" / "cecum_t1_a" / "0001_color.png"
    content = bytearray(spoilt.read_bytes())
    content[200:-50] = bytes(len(content) - 250)
    spoilt.write_bytes(content)
    arguments = [
        *TINY,
        f"data.root={tmp_path / 'copy'}",
        "data.workers=1",
        f"hydra.run.dir={tmp_path / 'spoilt'}",
    ]
    answer = call("train.py", *arguments, cwd=tmp_path)
    assert answer.returncode == 2
    errors = [line for line in answer.stderr.splitlines() if line.startswith("error:")]
    assert len(errors) == 1
    assert "0001_color.png" in errors[0]
    assert "Traceback" not in answer.stderr


def test_missing_videos_are_named_or_left_out(tiny: Compose, tmp_path: Path) -> None:
    train(tiny())
    root = tiny()["data"]["root"]
    split = [
        "data.split.train=[cecum_t1_a,cecum_t2_b]",
        "data.split.val=[trans_t1_a]",
        "data.split.test=[desc_t4_a]",
    ]
    camera = [
        "data=c3vd",
        "data/split=custom",
        f"data.root={root}",
        *split,
        f"output_dir={tmp_path / 'other'}",
    ]
    with refused(DataError, None, "cecum_t2_b"):
        train(composed("train", "preset=smoke", *camera))


def test_five_real_frames(tmp_path: Path) -> None:
    root = real_frames("sample_current")
    split = [f"data.split.{part}=[cecum_t1_a:0-240]" for part in ("train", "val", "test")]
    overrides = [
        "preset=smoke",
        "data=c3vd",
        "data/split=custom",
        *split,
        "data.normals=derived",
        "trainer.max_epochs=3",
    ]
    best = train(composed("train", *overrides, f"data.root={root}", f"output_dir={tmp_path}"))
    rows = read_per_frame(tmp_path / "per_frame.csv")
    assert [row["frame"] for row in rows] == ["0", "60", "120", "180", "240"]
    assert {row["segment"] for row in rows} == {"cecum"}
    assert 0 < best < 2


def test_the_paper_split_wants_all_of_c3vd(tmp_path: Path) -> None:
    root = real_frames("sample_current")
    overrides = [
        "preset=smoke",
        "data=c3vd",
        "data.normals=derived",
        f"data.root={root}",
        f"output_dir={tmp_path}",
    ]
    with refused(DataError, None, "trans_t4_b", "missing"):
        train(composed("train", *overrides))
    with refused(DataError, f"data.root={root}", "data.split.val"):
        train(composed("train", *overrides, "data.allow_missing=true"))


def test_generated_code_is_asked_for(
    phantom_root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of the network that is trained, and of the one that is scored, whose weights stay as they are."""
    asked: list[bool] = []

    def compile_network(network: DepthNetwork, trained: bool = False, cudagraphs: bool = False) -> None:
        asked.append(trained)

    monkeypatch.setattr("col3d.training.train.compile_network", compile_network)
    monkeypatch.setattr("col3d.evaluation.evaluate.compile_network", compile_network)
    place = (f"data.root={phantom_root}", f"output_dir={tmp_path / 'run'}")
    train(composed("train", *TINY, *place, "model=bts", SMALL, "trainer.compile=true"))
    score(tmp_path / "run" / "checkpoints" / "best.ckpt", "compile=true")
    assert asked == [False, True]


def test_code_cannot_be_generated_without_a_compiler(
    phantom_root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CXX", "no-such-compiler")
    place = (f"data.root={phantom_root}", f"output_dir={tmp_path / 'run'}")
    with refused(UserError, "compile", "C++ compiler", "no-such-compiler"):
        train(composed("train", *TINY, *place, "model=bts", SMALL, "trainer.compile=true"))
    assert not (tmp_path / "run").exists()
