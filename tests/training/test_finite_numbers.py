"""Numbers that are not finite stop the training before they do harm, and leave the batch behind."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import pytest
import torch
from lightning import Callback, LightningModule, Trainer
from refusals import refused
from torch import nn

from col3d.errors import DivergedError
from col3d.training.callbacks.finite_numbers import FiniteNumbers


class OneWeight(LightningModule):
    """Its loss turns bad at the given step."""

    def __init__(self, step: int, bad: float, bad_gradient: bool = False) -> None:
        super().__init__()
        self.step, self.bad, self.bad_gradient = step, bad, bad_gradient
        self.weight = nn.Parameter(torch.ones(()))

    def training_step(self, batch: Any, batch_idx: int) -> torch.Tensor:
        here = batch_idx == self.step
        self.last_terms = {"depth": torch.tensor(1.0), "normals": torch.tensor(self.bad if here else 2.0)}
        if here and self.bad_gradient:  # the root's derivative at 0 is infinite, the root is 0
            return (self.weight * 0).sqrt()
        return self.weight * (self.bad if here else 1.0)

    def configure_optimizers(self) -> torch.optim.Optimizer:
        return torch.optim.SGD(self.parameters(), lr=0.1)


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), -float("inf")])
def test_step_and_frames_are_named(bad: float) -> None:
    callback, trainer = FiniteNumbers(), Mock(spec=Trainer, fit_loop=SimpleNamespace(total_batch_idx=41))
    trainer.current_epoch = 0
    module = Mock(spec=LightningModule)
    batch = {"video": ["cecum_t1_a", "desc_t4_a"], "frame": torch.tensor([7, 130])}
    callback.on_train_batch_start(trainer, module, batch, 0)
    callback.on_before_backward(trainer, module, torch.tensor(1e30))
    with refused(DivergedError, None, bad, "step 41", "cecum_t1_a:7, desc_t4_a:130"):
        callback.on_before_backward(trainer, module, torch.tensor(bad))


def fit(module: LightningModule, *callbacks: Callback) -> None:
    batches = [{"video": ["a"], "frame": torch.tensor([k]), "image": torch.ones(2)} for k in range(4)]
    trainer = Trainer(
        max_epochs=1, accelerator="cpu", logger=False, enable_checkpointing=False,
        enable_progress_bar=False, enable_model_summary=False, callbacks=[*callbacks],
    )  # fmt: skip
    trainer.fit(module, torch.utils.data.DataLoader(batches, batch_size=None))  # type: ignore[arg-type]


def test_weights_are_not_spoiled(tmp_path: Path) -> None:
    module = OneWeight(step=2, bad=float("nan"))

    with refused(DivergedError, None, "loss_normals", "step 2 ", "frames a:2;", tmp_path / "bad_batch.pt"):
        fit(module, FiniteNumbers(tmp_path))
    assert module.weight.item() == pytest.approx(0.8)
    kept = torch.load(tmp_path / "bad_batch.pt", weights_only=True)
    assert (kept["epoch"], kept["step"], kept["terms"]["depth"]) == (0, 2, 1.0)
    assert (kept["batch"]["video"], kept["batch"]["frame"].tolist()) == (["a"], [2])
    assert torch.equal(kept["batch"]["image"], torch.ones(2))
    assert [path.name for path in tmp_path.iterdir()] == ["bad_batch.pt"]


def test_a_gradient_is_refused_where_the_loss_is_fine(tmp_path: Path) -> None:
    module = OneWeight(step=1, bad=0.0, bad_gradient=True)
    with refused(DivergedError, None, "gradient of weight ", "step 1 ", "frames a:1;"):
        fit(module, FiniteNumbers(tmp_path))
    assert module.weight.item() == pytest.approx(0.9)
    assert "gradient" in torch.load(tmp_path / "bad_batch.pt", weights_only=True)["reason"]


def test_large_gradients_that_are_finite_go_on() -> None:
    callback, module = FiniteNumbers(), OneWeight(step=9, bad=0.0)
    module.weight.grad = torch.tensor(3e38)
    optimizer = torch.optim.SGD([{"params": [module.weight]}], lr=0.1)
    progress = SimpleNamespace(total_batch_idx=0)
    trainer = Mock(spec=Trainer, precision="32-true", fit_loop=progress, current_epoch=0)
    callback.on_before_optimizer_step(trainer, module, optimizer)


class Saves(Callback):
    """Saves after each step, as a checkpoint by minutes may."""

    def __init__(self, path: Path) -> None:
        self.path, self.saved = path, list[int]()

    def on_train_batch_end(self, trainer: Trainer, *_: Any) -> None:
        trainer.save_checkpoint(self.path)
        self.saved.append(trainer.global_step)


@pytest.mark.parametrize(
    ("module", "said"),
    [
        (OneWeight(step=1, bad=float("nan")), ("nan", "loss_normals")),
        (OneWeight(step=1, bad=0.0, bad_gradient=True), ("gradient",)),
    ],
)
def test_a_host_that_runs_ahead_names_the_step_of_before(
    module: OneWeight, said: tuple[str, ...], tmp_path: Path
) -> None:
    with refused(DivergedError, None, *said, "step 1 ", "frames a:1;"):
        fit(module, FiniteNumbers(tmp_path, late=2))
    assert torch.isnan(module.weight)
    kept = torch.load(tmp_path / "bad_batch.pt", weights_only=True)
    assert (kept["step"], kept["batch"]["frame"].tolist()) == (1, [1])


@pytest.mark.parametrize("step", range(4))
def test_a_host_that_runs_ahead_reads_all_at_the_end_of_an_epoch(step: int) -> None:
    with refused(DivergedError, None, f"step {step} "):
        fit(OneWeight(step=step, bad=float("inf")), FiniteNumbers(late=10))


def test_nothing_is_saved_after_a_bad_step(tmp_path: Path) -> None:
    saves = Saves(tmp_path / "last.ckpt")
    with refused(DivergedError, None, "step 2 "):
        fit(OneWeight(step=2, bad=float("nan")), FiniteNumbers(late=10), saves)
    assert saves.saved == [1, 2]
    assert torch.load(saves.path)["state_dict"]["weight"] == pytest.approx(0.8)
