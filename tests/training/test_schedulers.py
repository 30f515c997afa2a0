"""Schedules by name: each of torch steps and goes on, with its own options, checked."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from lightning import Callback, LightningModule, Trainer
from lightning.pytorch.callbacks import ModelCheckpoint
from refusals import refused
from tiny_task import LOSS, QUIET, TinyNetwork, frames
from torch import nn
from torch.optim import lr_scheduler
from torch.optim.lr_scheduler import LRScheduler
from torch.utils.data import DataLoader

from col3d.errors import OptionError, UserError
from col3d.registry import SCHEDULERS, available, describe, register_scheduler
from col3d.registry.refusals import checked
from col3d.training.schedulers import (
    SchedulerOptions,
    TrainingLength,
    interval_of,
    is_of_length,
    node,
    polynomial,
    scheduler_of,
    scheduler_options,
    step,
    try_schedule,
)
from col3d.training.tasks import SupervisedTask

NEEDED: dict[str, dict[str, Any]] = {
    "OneCycleLR": {"max_lr": 0.1},
    "CyclicLR": {"base_lr": 0.01, "max_lr": 0.1, "step_size_up": 2, "cycle_momentum": False},
    "StepLR": {"step_size": 2},
    "MultiStepLR": {"milestones": [1, 3]},
    "ExponentialLR": {"gamma": 0.5},
    "CosineAnnealingWarmRestarts": {"T_0": 2},
    "ConstantLR": {"total_iters": 2},
    "step": {"epochs": 1},
}
"""What schedules cannot do without."""


def options(name: str, **changes: Any) -> Any:
    given = {key: value for key, value in node(SCHEDULERS[name]).items() if value != "???"}
    return scheduler_options({**given, **NEEDED.get(name, {}), **changes})


def sgd(rate: float = 2.0, groups: int = 1) -> torch.optim.Optimizer:
    made = [{"params": [nn.Parameter(torch.zeros(()))]} for _ in range(groups)]
    return torch.optim.SGD(made, lr=rate, momentum=0.9)


def rates(schedule: Any, optimizer: torch.optim.Optimizer, steps: int) -> list[float]:
    found = []
    for _ in range(steps):
        found.append(optimizer.param_groups[0]["lr"])
        optimizer.step()
        schedule.step()
    return found


def test_what_torch_has_is_here() -> None:
    theirs = {"OneCycleLR", "CosineAnnealingLR", "CosineAnnealingWarmRestarts", "CyclicLR", "LinearLR"}
    theirs |= {"StepLR", "MultiStepLR", "ConstantLR", "ExponentialLR", "PolynomialLR", "ReduceLROnPlateau"}
    assert {*available("scheduler")} == {"constant", "polynomial", "step", *theirs}
    assert "scheduler.power" in describe("scheduler", "polynomial")


@pytest.mark.parametrize(
    ("name", "given", "torchs"),
    [
        ("OneCycleLR", {}, lambda o: lr_scheduler.OneCycleLR(o, 0.1, total_steps=12)),
        (
            "OneCycleLR",
            {"total_steps": 20, "pct_start": 0.5},
            lambda o: lr_scheduler.OneCycleLR(o, 0.1, 20, pct_start=0.5),
        ),
        ("OneCycleLR", {"epochs": 5}, lambda o: lr_scheduler.OneCycleLR(o, 0.1, total_steps=20)),
        ("OneCycleLR", {"steps_per_epoch": 6}, lambda o: lr_scheduler.OneCycleLR(o, 0.1, total_steps=18)),
        ("CosineAnnealingLR", {"eta_min": 0.1}, lambda o: lr_scheduler.CosineAnnealingLR(o, 12, 0.1)),
        ("CosineAnnealingLR", {"T_max": 4}, lambda o: lr_scheduler.CosineAnnealingLR(o, 4)),
        ("PolynomialLR", {"power": 2.0}, lambda o: lr_scheduler.PolynomialLR(o, 12, 2.0)),
        ("LinearLR", {"total_iters": 3}, lambda o: lr_scheduler.LinearLR(o, total_iters=3)),
        ("LinearLR", {"total_iters": "none"}, lambda o: lr_scheduler.LinearLR(o, total_iters=12)),
        ("MultiStepLR", {}, lambda o: lr_scheduler.MultiStepLR(o, [1, 3])),
    ],
)
def test_counts_are_those_of_the_training_unless_given(name: str, given: Any, torchs: Any) -> None:
    ours, theirs = sgd(), sgd()
    built = scheduler_of(options(name, **given))(ours, 12, 3)
    assert rates(built, ours, 12) == rates(torchs(theirs), theirs, 12)
    assert is_of_length(options(name, **given)) == (
        name in ("OneCycleLR", "CosineAnnealingLR", "PolynomialLR", "LinearLR")
        and given.get("T_max", given.get("total_steps", given.get("total_iters", "none"))) == "none"
    )


def test_ours_give_the_rates_of_before_to_the_bit() -> None:
    """Their formulas as they were: of steps, and of a period that is rounded down."""
    expected = {
        "polynomial": [0.1 + 0.9 * (1 - max(0.0, s - 0.25 * 10) / 7.5) ** 0.9 for s in range(10)],
        "step": [0.1 ** (s // (2 * 10 // 3)) for s in range(10)],
    }
    for name, changes in (("polynomial", {"hold": 0.25}), ("step", {"epochs": 2})):
        optimizer = sgd(1.0)
        built = scheduler_of(options(name, **changes))(optimizer, 10, 3)
        assert rates(built, optimizer, 10) == expected[name]
    assert scheduler_of(options("constant"))(sgd(), 10, 3) is None
    assert [interval_of(options(name)) for name in ("constant", "polynomial", "step")] == ["step"] * 3


def test_rates_of_groups_keep_their_scale() -> None:
    optimizer = sgd(groups=2)
    optimizer.param_groups[0]["lr_scale"] = 0.5
    scheduler_of(options("OneCycleLR"))(optimizer, 12, 3)
    assert [group["max_lr"] for group in optimizer.param_groups] == pytest.approx([0.05, 0.1])


class Rates(Callback):
    """Those of each step."""

    def __init__(self) -> None:
        self.rates = list[float]()

    def on_train_batch_start(
        self, trainer: Trainer, pl_module: LightningModule, batch: Any, batch_idx: int
    ) -> None:
        self.rates.append(trainer.optimizers[0].param_groups[0]["lr"])


def fitted(name: str, folder: Path, start: Path | None = None, **changes: Any) -> list[float]:
    """The rates of four epochs of two steps, each epoch saved as trainings here save it."""
    given = options(name, **changes)
    torch.manual_seed(0)
    task = SupervisedTask(
        TinyNetwork(dropout=0.0),
        LOSS,
        lambda network: torch.optim.SGD(network.parameters(), lr=0.1, momentum=0.9),
        scheduler_of(given),
        interval=interval_of(given),
        monitor=getattr(given, "monitor", None),
    )
    watch = Rates()
    saving = ModelCheckpoint(folder, "{epoch}", save_top_k=-1, save_on_train_epoch_end=True)
    trainer = Trainer(**QUIET | {"max_epochs": 4, "callbacks": [watch, saving], "enable_checkpointing": True})
    loader: DataLoader[Any] = DataLoader(frames(), batch_size=2)  # type: ignore[arg-type]
    trainer.fit(task, loader, loader, ckpt_path=start, weights_only=True)
    return watch.rates


@pytest.mark.filterwarnings("ignore:Detected call of `lr_scheduler.step")
@pytest.mark.filterwarnings("ignore:The dirpath has changed|.*does not have many workers|.*exists and is not")
@pytest.mark.filterwarnings("ignore:A `OneCycleLR` scheduler is using|A `CyclicLR` scheduler is using")
@pytest.mark.parametrize("interval", ["step", "epoch", None])
@pytest.mark.parametrize("name", available("scheduler"))
def test_each_goes_on_at_the_rates_of_one_that_was_not_cut_off(
    name: str, interval: str | None, tmp_path: Path
) -> None:
    changes: dict[str, Any] = {} if interval is None else {"interval": interval}
    if name == "ReduceLROnPlateau":
        changes = {"patience": 0, "monitor": "val/abs_rel", "threshold": 0.5}
    whole = fitted(name, tmp_path, **changes)
    assert fitted(name, tmp_path / "again", tmp_path / "epoch=1.ckpt", **changes) == whole[4:]
    assert len(whole) == 8
    assert (len({*whole}) == 1) == (name == "constant")


def test_a_cycle_that_is_shorter_than_the_training_is_refused_before_its_first_step(tmp_path: Path) -> None:
    with refused(UserError, "scheduler.total_steps", 8, 3):
        fitted("OneCycleLR", tmp_path, total_steps=3)


@pytest.mark.parametrize(
    ("given", "about", "named"),
    [
        ({"name": "OneCycelLR"}, "scheduler.name", ("'OneCycelLR'", "'OneCycleLR'")),
        ({}, "scheduler.name", ("needed",)),
        ({"name": "LambdaLR"}, "scheduler.name", ("'LambdaLR'",)),
        ({"name": "StepLR", "step_size": 2, "gama": 0.1}, "scheduler.gama", ("'scheduler.gamma'",)),
        ({"name": "ReduceLROnPlateau", "interval": "step"}, "scheduler.interval", ("ReduceLROnPlateau ",)),
        ({"name": "StepLR", "step_size": 2, "monitor": "val/loss"}, "scheduler.monitor", ("no such option",)),
    ],
)
def test_each_mistake_is_one_line(given: dict[str, Any], about: str, named: tuple[str, ...]) -> None:
    with refused(OptionError, about, *named):
        scheduler_options(given)


@pytest.mark.parametrize(
    ("name", "given", "about", "named"),
    [
        ("OneCycleLR", {}, "scheduler.max_lr", ("needed",)),
        ("StepLR", {"step_size": "x"}, "scheduler.step_size", ("integer", "'x'")),
        ("CosineAnnealingLR", {"T_max": 0}, "scheduler.T_max", ("greater than 0", "got 0")),
        ("CosineAnnealingLR", {"interval": "batch"}, "scheduler.interval", ("'step' or 'epoch'", "'batch'")),
        ("step", {"factor": 0}, "scheduler.factor", ("greater than 0", "got 0")),
    ],
)
def test_values_are_held_against_the_signature(
    name: str, given: dict[str, Any], about: str, named: tuple[str, ...]
) -> None:
    from col3d.training.schedulers import base_class

    part = SCHEDULERS[name]
    with refused(OptionError, about, *named):
        checked(part.options(base_class(part)), {"name": name, **given}, "scheduler")


@pytest.mark.parametrize(
    ("name", "given", "optimizer", "named"),
    [
        ("OneCycleLR", {"pct_start": 2.0}, sgd(), "between 0 and 1"),
        (
            "CyclicLR",
            {"cycle_momentum": True},
            torch.optim.Adagrad([nn.Parameter(torch.zeros(()))]),
            "momentum",
        ),
        ("ReduceLROnPlateau", {"factor": 1.5}, sgd(), "Factor should be < 1.0"),
    ],
)
def test_rules_of_torch_are_one_line(name: str, given: Any, optimizer: Any, named: str) -> None:
    with refused(OptionError, "scheduler", f"{name}: ", named):
        try_schedule(options(name, **given), optimizer, 2)


def test_a_schedule_of_somebody_s_is_told_how_long_the_training_is() -> None:

    @register_scheduler("warm")
    def warm(optimizer: Any, training: Any, share: float = 0.5) -> Any:
        """A line upwards."""
        return lr_scheduler.LambdaLR(optimizer, lambda s: min(1.0, (s + 1) / (share * training.steps)))

    optimizer = sgd(1.0)
    found: SchedulerOptions = options("warm", share=1.0)
    assert interval_of(found) == "epoch"
    assert rates(scheduler_of(found)(optimizer, 4, 4), optimizer, 4) == [0.25, 0.5, 0.75, 1.0]
    assert not is_of_length(found)

    @register_scheduler("odd")
    def odd(optimizer: Any) -> Any:
        raise ValueError("mine")

    with refused(ValueError, None, "mine") as error:
        try_schedule(options("odd"), sgd(), 1)
    assert not isinstance(error.value, OptionError)


def rates_of(schedule: Callable[[Any], LRScheduler], steps: int) -> list[float]:
    """The learning rate of each step, from a start of 2, and the one after the last."""
    optimizer = torch.optim.SGD([nn.Parameter(torch.zeros(()))], lr=2.0)
    schedules, found = schedule(optimizer), []
    for _ in range(steps + 1):
        found.append(optimizer.param_groups[0]["lr"])
        optimizer.step()
        schedules.step()
    return found


@pytest.mark.parametrize(
    ("power", "final_ratio", "hold"), [(0.9, 0.1, 0.0), (1.0, 0.0, 0.5), (2.0, 0.3, 0.25)]
)
def test_polynomial_decay_equals_its_formula(power: float, final_ratio: float, hold: float) -> None:
    found = rates_of(
        lambda optimizer: polynomial(optimizer, TrainingLength(20, 1), power, final_ratio, hold), 20
    )
    for number, rate in enumerate(found):
        gone = max(0.0, (number / 20 - hold) / (1 - hold))
        assert rate == pytest.approx(2 * (final_ratio + (1 - final_ratio) * math.pow(1 - gone, power)))
    assert found[-1] == pytest.approx(2 * final_ratio)


def test_pix2pix_holds_for_half_of_the_steps_and_falls_in_a_line_to_zero() -> None:
    found = rates_of(lambda optimizer: polynomial(optimizer, TrainingLength(8, 1), 1.0, 0.0, 0.5), 8)
    assert found == pytest.approx([2, 2, 2, 2, 2, 1.5, 1, 0.5, 0])


def test_polynomial_decay_stays_at_its_end() -> None:
    found = rates_of(lambda optimizer: polynomial(optimizer, TrainingLength(3, 1), 0.9, 0.1, 0.5), 5)
    assert found[3:] == pytest.approx([0.2] * 3)
    assert found[2] > 0.3


def test_step_decay_falls_after_every_period() -> None:
    found = rates_of(lambda optimizer: step(optimizer, TrainingLength(7, 7), 3, 0.1), 7)
    assert found == pytest.approx([2, 2, 2, 0.2, 0.2, 0.2, 0.02, 0.02])
