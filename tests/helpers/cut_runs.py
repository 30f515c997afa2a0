"""Runs that are cut short at a chosen moment, and whether they end as if they had not been."""

import json
import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from tiny_run import SMALL

from col3d.evaluation.scorer import Scoring
from col3d.training.callbacks.epoch_lines import EpochLines
from col3d.training.tasks import SupervisedTask
from col3d.training.train import train

Compose = Callable[..., dict[str, Any]]
KEPT = (
    "state_dict",
    "optimizer_states",
    "lr_schedulers",
    "epoch",
    "global_step",
    "epoch_so_far",
    "depth_seen",
)
EPOCHS = 3
QUICK = ("model=bts", SMALL, "callbacks.panels=0")
SCORING = "scoring"
"""In place of a hook: when the first frames of the test are scored."""


def options(tiny: Compose, folder: Path, *overrides: str) -> dict[str, Any]:
    model = () if "model=pix2pix" in overrides else ("model=bts_cbam_mtl", SMALL)
    place = (f"output_dir={folder}", f"trainer.max_epochs={EPOCHS}")
    return tiny("callbacks.checkpoint_minutes=0", "callbacks.panels=0", *model, *place, *overrides)


def status_of(folder: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((folder / "status.json").read_text())
    return content


def assert_the_same(folder: Path, whole: Path) -> None:
    """Weights, optimiser, schedule and tables to the bit."""
    for name in ("last", "best"):
        found, expected = (
            torch.load(run / "checkpoints" / f"{name}.ckpt", weights_only=True) for run in (folder, whole)
        )
        for key in KEPT:
            torch.testing.assert_close(found[key], expected[key], rtol=0, atol=0, equal_nan=True)
    for name in ("metrics.csv", "per_frame.csv"):
        assert (folder / name).read_text() == (whole / name).read_text()
    results = [json.loads((run / "result.json").read_text()) for run in (folder, whole)]
    assert results[0]["best"] == results[1]["best"]


def gone_on(
    monkeypatch: pytest.MonkeyPatch,
    tiny: Compose,
    folder: Path,
    where: str,
    epoch: int,
    batch: int,
    *given: str,
) -> Path:
    """A run that SIGTERM stopped and that went on, the same to the bit as the one in `whole` beside it."""
    train(options(tiny, folder / "whole", *given))
    with monkeypatch.context() as patched:
        stopped_in(patched, where, epoch, batch, signal.SIGTERM)
        with pytest.raises(SystemExit):
            train(options(tiny, folder / "cut", *given))
    train(options(tiny, folder / "cut", *given))
    assert status_of(folder / "cut")["sessions"] == 2
    assert_the_same(folder / "cut", folder / "whole")
    return folder / "cut"


def at(
    monkeypatch: pytest.MonkeyPatch, where: str, epoch: int, batch: int, event: Callable[[], None]
) -> None:
    """Let something happen in a hook of the task at an epoch and batch, or in `SCORING`."""
    if where == SCORING:
        add = Scoring.add

        def with_event(scoring: Scoring, *given: Any) -> None:
            event()
            add(scoring, *given)

        monkeypatch.setattr(Scoring, "add", with_event)
        return
    hook = getattr(SupervisedTask, where)

    def hook_with_event(task: SupervisedTask, given: Any, batch_idx: int) -> Any:
        if (task.current_epoch, batch_idx) == (epoch, batch):
            event()
        return hook(task, given, batch_idx)

    monkeypatch.setattr(SupervisedTask, where, hook_with_event)


def stopped_in(monkeypatch: pytest.MonkeyPatch, where: str, epoch: int, batch: int, signum: int) -> None:
    """Send a signal to this process; see `at`."""
    at(monkeypatch, where, epoch, batch, lambda: os.kill(os.getpid(), signum))


def result(folder: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((folder / "result.json").read_text())
    return content


class PowerCutError(Exception):
    """What ends a training at once."""


def cut_in(monkeypatch: pytest.MonkeyPatch, epoch: int) -> None:
    """Let the power fail at the end of an epoch."""

    def cut(self: EpochLines, trainer: Any, pl_module: Any) -> None:
        if trainer.current_epoch == epoch:
            raise PowerCutError

    monkeypatch.setattr(EpochLines, "on_train_epoch_end", cut)
