"""One line an epoch."""

from typing import Any
from unittest.mock import Mock

import pytest
import torch
from lightning import LightningModule, Trainer

from col3d.training.callbacks.epoch_lines import EpochLines


def lines(capsys: Any, first: int, zero: bool = True) -> list[str]:
    callback = EpochLines()
    metrics = {"train/loss": torch.tensor(1.25), "val/rmse": torch.tensor(9.0)}
    trainer, module = Mock(spec=Trainer), Mock(spec=LightningModule)
    trainer.configure_mock(current_epoch=first, max_epochs=5, callback_metrics=metrics, is_global_zero=zero)
    callback.on_fit_start(trainer, module)
    for trainer.current_epoch in range(first, 5):
        callback.on_train_epoch_end(trainer, module)
    found: list[str] = capsys.readouterr().out.splitlines()
    return found


@pytest.mark.parametrize("first", [0, 3])
def test_a_line_for_each_epoch(capsys: Any, first: int) -> None:
    found = lines(capsys, first)
    assert [line.split()[1] for line in found] == [f"{n}/5" for n in range(first + 1, 6)]
    assert all("train/loss 1.2500" in line and "rmse" not in line for line in found)
    assert found[-1].endswith(" 0 s left")


def test_other_processes_are_silent(capsys: Any) -> None:
    assert lines(capsys, 0, zero=False) == []
