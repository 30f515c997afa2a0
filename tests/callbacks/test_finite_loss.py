"""A loss that is not finite stops the training before it does harm."""

from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import pytest
import torch
from lightning import LightningModule, Trainer
from torch import nn

from col3d.callbacks import FiniteLoss
from col3d.callbacks.finite_loss import DivergedError


class OneWeight(LightningModule):
    """Its loss turns bad at the given step."""

    def __init__(self, step: int, bad: float) -> None:
        super().__init__()
        self.step, self.bad = step, bad
        self.weight = nn.Parameter(torch.ones(()))

    def training_step(self, batch: Any, batch_idx: int) -> torch.Tensor:
        return self.weight * (self.bad if batch_idx == self.step else 1.0)

    def configure_optimizers(self) -> torch.optim.Optimizer:
        return torch.optim.SGD(self.parameters(), lr=0.1)


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), -float("inf")])
def test_step_and_frames_are_named(bad: float) -> None:
    callback, trainer = FiniteLoss(), Mock(spec=Trainer, fit_loop=SimpleNamespace(total_batch_idx=41))
    module = Mock(spec=LightningModule)
    batch = {"video": ["cecum_t1_a", "desc_t4_a"], "frame": torch.tensor([7, 130])}
    callback.on_train_batch_start(trainer, module, batch, 0)
    callback.on_before_backward(trainer, module, torch.tensor(1e30))
    with pytest.raises(DivergedError, match=r"at step 41 \(frames cecum_t1_a:7, desc_t4_a:130\)"):
        callback.on_before_backward(trainer, module, torch.tensor(bad))


def test_weights_are_not_spoiled() -> None:
    module = OneWeight(step=2, bad=float("nan"))
    batches = [{"video": ["a"], "frame": torch.tensor([k])} for k in range(4)]
    trainer = Trainer(
        max_epochs=1, accelerator="cpu", logger=False, enable_checkpointing=False,
        enable_progress_bar=False, enable_model_summary=False, callbacks=[FiniteLoss()],
    )  # fmt: skip
    with pytest.raises(DivergedError, match=r"step 2 \(frames a:2\)"):
        trainer.fit(module, torch.utils.data.DataLoader(batches, batch_size=None))  # type: ignore[arg-type]
    assert module.weight.item() == pytest.approx(0.8)
