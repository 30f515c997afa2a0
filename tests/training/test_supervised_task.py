"""What a supervised training says of its frames, and of those that have no truth."""

from typing import Any

import pytest
import torch
from lightning import Trainer
from tiny_task import LOSS, QUIET, TinyNetwork, adam, frames
from torch.utils.data import DataLoader

from col3d.training.tasks import SupervisedTask


def fitted(items: list[dict[str, Any]], epochs: int = 1) -> dict[str, float]:
    torch.manual_seed(0)
    task = SupervisedTask(TinyNetwork(dropout=0.0), LOSS, adam)
    trainer = Trainer(**QUIET | {"max_epochs": epochs})
    loader: DataLoader[Any] = DataLoader(items, batch_size=2)  # type: ignore[arg-type]
    trainer.fit(task, loader, DataLoader(frames(), batch_size=2))  # type: ignore[arg-type]
    return {name: value.item() for name, value in trainer.callback_metrics.items()}


@pytest.mark.parametrize("epochs", [1, 2])
def test_frames_without_truth_are_counted_and_teach_nothing(epochs: int) -> None:
    without = frames()
    for item in without[2:]:
        item["mask"] = torch.zeros_like(item["mask"])
    found = fitted(without, epochs)
    assert found["train/frames_without_truth"] == 2
    assert fitted(frames(), epochs)["train/frames_without_truth"] == 0
    assert all(torch.tensor(value).isfinite() for value in found.values())


def test_the_rate_is_that_of_the_steps() -> None:
    assert fitted(frames())["train/lr"] == pytest.approx(1e-2)
