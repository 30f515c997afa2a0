"""What Lightning's Trainer takes is passed on, or refused with the reason."""

import json
import os
import signal
from collections.abc import Callable
from inspect import signature
from pathlib import Path
from typing import Any

import pytest
from cut_runs import gone_on, options, stopped_in
from lightning import Trainer
from programs import call
from refusals import refusal, refused
from tiny_run import TINY, composed

from col3d.errors import UserError
from col3d.registry.refusals import check_options
from col3d.training.options import TrainOptions
from col3d.training.tasks import SupervisedTask
from col3d.training.train import train
from col3d.training.trainer import make_trainer
from col3d.training.trainer_options import REASONS, TrainerOptions

pytestmark = pytest.mark.end_to_end

Compose = Callable[..., dict[str, Any]]
SELDOM = "callbacks.checkpoint_minutes=60"
RENAMED = {"accumulate": "accumulate_grad_batches", "gradient_clip": "gradient_clip_val"}
OURS = {"compile", "cudagraphs"}


def checked(*overrides: str) -> TrainOptions:
    return check_options(TrainOptions, composed("train", "output_dir=x", *overrides))


def test_each_argument_of_the_trainer_is_taken_or_refused_with_a_reason() -> None:
    theirs = {*signature(Trainer).parameters}
    ours = {RENAMED.get(name, name) for name in TrainerOptions.model_fields} - OURS
    assert ours | {*REASONS} == theirs
    assert ours & {*REASONS} == {*RENAMED.values()}


@pytest.mark.parametrize(
    ("override", "attribute", "value"),
    [
        ("trainer.limit_val_batches=2", "limit_val_batches", 2),
        ("trainer.limit_train_batches=0.5", "limit_train_batches", 0.5),
        ("trainer.limit_test_batches=1.0", "limit_test_batches", 1.0),
        ("trainer.check_val_every_n_epoch=2", "check_val_every_n_epoch", 2),
        ("trainer.overfit_batches=1", "overfit_batches", 1),
        ("trainer.min_epochs=2", "min_epochs", 2),
        ("trainer.log_every_n_steps=7", "log_every_n_steps", 7),
    ],
)
def test_what_is_given_reaches_the_trainer(override: str, attribute: str, value: Any) -> None:
    given = checked("trainer.accelerator=cpu", override).trainer
    assert getattr(make_trainer(given, [], []), attribute) == value


@pytest.mark.parametrize(
    ("overrides", "about", "named"),
    [
        (["++trainer.max_steps=5"], "trainer.max_steps", ("trainer.max_epochs",)),
        (["++trainer.gradient_clip_val=1"], "trainer.gradient_clip_val", ("trainer.gradient_clip",)),
        (["++trainer.max_epoch=5"], "trainer.max_epoch", ("'trainer.max_epochs'",)),
        (["trainer.limit_val_batches=0"], "trainer.limit_val_batches", ("greater than 0", "got 0")),
        (["trainer.limit_val_batches=1.5"], "trainer.limit_val_batches", ("1.5",)),
        (["trainer.check_val_every_n_epoch=99"], "trainer.check_val_every_n_epoch", ("at most", "99")),
        (["trainer.profiler=fast"], "trainer.profiler", ("'simple', 'advanced' or 'pytorch'", "'fast'")),
        (
            ["trainer.gradient_clip_algorithm=value"],
            "trainer.gradient_clip_algorithm",
            ("needs trainer.gradient_clip",),
        ),
        (["trainer.cudagraphs=true"], "trainer.cudagraphs", ["trainer.compile=true"]),
        (
            ["callbacks.predictions=true", "trainer.num_nodes=2"],
            "callbacks.predictions",
            ("trainer.devices=1", "trainer.num_nodes=2"),
        ),
        (
            ["model=pix2pix", "trainer.gradient_clip=1.0", "trainer.gradient_clip_algorithm=value"],
            "trainer.gradient_clip_algorithm",
            ("task=adversarial", "norm", "got value"),
        ),
    ],
)
def test_each_mistake_is_one_line(overrides: list[str], about: str, named: tuple[str, ...]) -> None:
    with refused(UserError, about, *named) as error:
        checked(*overrides)
    assert "\n" not in str(error.value)


def test_on_the_command_line_the_reason_is_said(tmp_path: Path) -> None:
    given = ("trainer.max_steps=3", "trainer.max_epoch=2")
    for argument in given:
        answer = call("train.py", *TINY, argument, f"hydra.run.dir={tmp_path / 'run'}", cwd=tmp_path)
        assert answer.returncode == 2
        assert refusal(answer.stderr).about == argument.partition("=")[0]
        assert "trainer.max_epochs" in answer.stderr


@pytest.mark.parametrize(
    ("more", "where", "epoch", "batch"),
    [
        (["trainer.check_val_every_n_epoch=2", "trainer.max_epochs=4"], "on_train_batch_start", 2, 1),
        (["trainer.overfit_batches=2"], "on_train_batch_start", 1, 1),
        (["trainer.limit_train_batches=0.5", "trainer.limit_val_batches=1"], "on_train_batch_start", 2, 0),
    ],
)
def test_a_run_with_them_goes_on_to_the_bit(
    more: list[str], where: str, epoch: int, batch: int, tiny: Compose, tmp_path: Path, monkeypatch: Any
) -> None:
    cut = gone_on(monkeypatch, tiny, tmp_path, where, epoch, batch, SELDOM, "data.batch_size=1", *more)
    lines = (cut / "metrics.csv").read_text().splitlines()
    place = lines[0].split(",").index("train/loss")
    epochs = json.loads((cut / "result.json").read_text())["epochs"]
    assert sum(bool(line.split(",")[place]) for line in lines[1:]) == epochs


def test_a_profile_is_in_the_run_s_folder_and_makes_no_other_run(
    tiny: Compose, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / "run"
    train(options(tiny, run, "trainer.max_epochs=1", "trainer.profiler=simple"))
    assert "run_training_epoch" in (run / "profile" / "fit-simple.txt").read_text()
    capsys.readouterr()
    train(options(tiny, run, "trainer.max_epochs=1"))
    assert "finished before" in capsys.readouterr().out


def test_a_trial_leaves_nothing_and_touches_no_run(
    tiny: Compose, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path / "temporary"))
    monkeypatch.setattr("tempfile.tempdir", None)
    (tmp_path / "temporary").mkdir()
    run = tmp_path / "run"
    score = train(options(tiny, run, "trainer.fast_dev_run=true", "logger=tensorboard"))
    said = capsys.readouterr().out
    assert "epoch 1/1" in said
    assert said.rstrip().endswith(
        "1 batch(es) of training, validation and test went through; nothing is kept"
    )
    assert isinstance(score, float)
    assert not run.exists()
    assert not list((tmp_path / "temporary").iterdir())
    train(options(tiny, run, "trainer.max_epochs=1"))
    before = {path: path.stat().st_mtime_ns for path in run.rglob("*") if path.is_file()}
    train(options(tiny, run, "trainer.fast_dev_run=2", "overwrite=true"))
    assert {path: path.stat().st_mtime_ns for path in run.rglob("*") if path.is_file()} == before
    assert "COL3D_FAST_DEV_RUN" not in os.environ


def test_batches_to_learn_by_heart_are_the_same_in_each_epoch(
    tiny: Compose, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[tuple[int, str, int]] = []
    hook = SupervisedTask.training_step

    def remembered(task: SupervisedTask, batch: Any, batch_idx: int) -> Any:
        frames = zip(batch["video"], batch["frame"].tolist(), strict=True)
        seen.extend((task.current_epoch, *frame) for frame in frames)
        return hook(task, batch, batch_idx)

    monkeypatch.setattr(SupervisedTask, "training_step", remembered)
    given = (SELDOM, "data.batch_size=1", "trainer.overfit_batches=2")
    with monkeypatch.context() as patched:
        stopped_in(patched, "on_train_batch_start", 2, 0, signal.SIGTERM)
        with pytest.raises(SystemExit):
            train(options(tiny, tmp_path / "cut", *given))
    train(options(tiny, tmp_path / "cut", *given))
    by_epoch = [[frame for epoch, *frame in seen if epoch == number] for number in range(3)]
    assert by_epoch[0] == by_epoch[1] == by_epoch[2]
    assert len(by_epoch[0]) == 2
