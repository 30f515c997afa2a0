"""Weights of another network with another head, an encoder that learns later, and rates of its layers."""

import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from cut_runs import assert_the_same, options, stopped_in
from programs import call
from refusals import refused
from tiny_run import SMALL, TINY, composed

from col3d.errors import UserError
from col3d.models import create
from col3d.registry.refusals import check_options
from col3d.training.initial_weights import begin_from
from col3d.training.options import InitOptions, TrainOptions
from col3d.training.tasks import SupervisedTask
from col3d.training.train import train

pytestmark = pytest.mark.end_to_end

Compose = Callable[..., dict[str, Any]]
SELDOM = "callbacks.checkpoint_minutes=60"
LATER = ("model.freeze=[encoder]", "model.unfreeze_at=1")
STEM = "network.encoder.net.conv_stem.weight"


def weights(run: Path, name: str = "last") -> dict[str, torch.Tensor]:
    state: dict[str, torch.Tensor] = torch.load(run / "checkpoints" / f"{name}.ckpt", weights_only=True)[
        "state_dict"
    ]
    return state


@pytest.mark.parametrize(("epoch", "batch"), [(0, 1), (1, 1), (2, 0)])
def test_an_encoder_that_learns_later_goes_on_to_the_bit(
    epoch: int, batch: int, tiny: Compose, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = (SELDOM, "data.batch_size=1", "optimizer.layer_decay=0.8", *LATER)
    train(options(tiny, tmp_path / "whole", *given))
    with monkeypatch.context() as patched:
        stopped_in(patched, "on_train_batch_start", epoch, batch, signal.SIGTERM)
        with pytest.raises(SystemExit):
            train(options(tiny, tmp_path / "cut", *given))
    train(options(tiny, tmp_path / "cut", *given))
    assert_the_same(tmp_path / "cut", tmp_path / "whole")


def test_it_stays_until_then_and_learns_from_then_on(
    tiny: Compose, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stems: dict[int, list[torch.Tensor]] = {0: [], 1: []}
    hook = SupervisedTask.on_train_batch_start

    def remembered(task: SupervisedTask, batch: Any, batch_idx: int) -> None:
        stems[task.current_epoch].append(task.state_dict()[STEM].clone())
        hook(task, batch, batch_idx)

    monkeypatch.setattr(SupervisedTask, "on_train_batch_start", remembered)
    train(options(tiny, tmp_path / "run", "data.batch_size=1", "trainer.max_epochs=2", *LATER))
    assert all(torch.equal(stem, stems[0][0]) for stem in [*stems[0], stems[1][0]])
    assert not torch.equal(stems[1][1], stems[1][0])


def test_two_processes_train_it_alike(tiny: Compose, tmp_path: Path) -> None:
    given = tiny("model=bts", SMALL)
    more = ["trainer=ddp", "trainer.devices=2", "trainer.accelerator=cpu", "trainer.max_epochs=2", *LATER]
    arguments = [*TINY, "model=bts", SMALL, *more, f"data.root={given['data']['root']}", "data.batch_size=1"]
    answer = call("train.py", *arguments, f"hydra.run.dir={tmp_path / 'ddp'}", cwd=tmp_path)
    assert answer.returncode == 0, answer.stderr
    assert torch.isfinite(weights(tmp_path / "ddp")[STEM]).all()


@pytest.mark.parametrize(
    ("overrides", "about", "named"),
    [
        (["model.unfreeze_at=1"], "model.unfreeze_at", ("model.freeze=[encoder]",)),
        (["model.freeze=[encoder]", "model.unfreeze_at=50"], "model.unfreeze_at", ("fewer", "50")),
        (["model.freeze=[encoder]", "model.unfreeze_at=0"], "model.unfreeze_at", ("greater", "got 0")),
        (["optimizer.layer_decay=1.5"], "optimizer.layer_decay", ("equal to 1", "got 1.5")),
        (["optimizer.encoder_lr=0"], "optimizer.encoder_lr", ("greater than 0", "got 0")),
    ],
)
def test_each_mistake_is_one_line(overrides: list[str], about: str, named: tuple[str, ...]) -> None:
    with refused(UserError, about, *named) as error:
        check_options(TrainOptions, composed("train", "output_dir=x", *overrides))
    assert "\n" not in str(error.value)


def test_a_table_says_what_another_head_leaves_out(tiny_checkpoint: Path) -> None:
    other = create("bts", encoder="lcnet_035", width=64, normals="unc", pretrained=None)
    before = {name: values.clone() for name, values in other.state_dict().items()}
    said: list[str] = []
    begin_from(other, InitOptions(checkpoint=str(tiny_checkpoint)), said.append)
    given = torch.load(tiny_checkpoint, weights_only=True)["state_dict"]
    given = {name.removeprefix("network."): values for name, values in given.items()}
    counted = {"taken": 0, "not there": 0, "of another shape there": 0, "not used": 0}
    for name in {**other.state_dict(), **given}:
        if name not in before:
            counted["not used"] += 1
        elif name not in given:
            counted["not there"] += 1
        else:
            same = given[name].shape == before[name].shape
            counted["taken" if same else "of another shape there"] += 1
    assert said[0] == (f"begins from {counted['taken']} of {len(before)} tensors of {tiny_checkpoint}")
    assert said[1].split() == ["tensors", *" ".join(counted).split()]
    rows = [line.split() for line in said[2:] if line.split()[1:] and line.split()[-1].isdigit()]
    sums = [sum(int(row[column]) for row in rows) for column in range(1, 5)]
    assert sums == [*counted.values()]
    assert said[-1] == "  what was not taken is as it was initialised"


def test_shapes_that_differ_are_said() -> None:
    class Head(torch.nn.Module):
        def __init__(self, channels: int) -> None:
            super().__init__()
            self.body, self.head = torch.nn.Conv2d(3, 4, 1), torch.nn.Conv2d(4, channels, 1)

    import col3d.training.initial_weights as module

    said: list[str] = []
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(module, "checked_weights", lambda options: Head(2).state_dict())
        begin_from(Head(1), InitOptions(checkpoint="some.ckpt"), said.append)
    assert said == [
        "begins from 2 of 4 tensors of some.ckpt",
        "  tensors  taken  not there  of another shape there  not used",
        "  body         2          0                       0         0",
        "  head         0          0                       2         0",
        "  head.weight (1, 4, 1, 1), there (2, 4, 1, 1)",
        "  head.bias (1,), there (2,)",
        "  what was not taken is as it was initialised",
    ]


def test_a_training_of_another_head_loss_and_rate_begins_there(
    tiny_checkpoint: Path, tiny: Compose, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = ("model=bts", SMALL, "loss.lambdas=[2.0]", "optimizer=lion", "optimizer.lr=1e-5")
    train(tiny(*other, f"init.checkpoint={tiny_checkpoint}", "optimizer.encoder_lr=1e-6"))
    said = capsys.readouterr().out
    assert "begins from" in said
    assert "tensors  " in said
