"""The best epoch is one with a finite value, and what is kept of it follows its folder."""

from pathlib import Path

import pytest
import torch
from lightning import LightningModule, Trainer
from torch import nn

from col3d.runs.checkpoint_callbacks import BestCheckpoint


class Epochs(LightningModule):
    """Its monitored value is one of a list, by epoch."""

    def __init__(self, values: list[float]) -> None:
        super().__init__()
        self.values = values
        self.weight = nn.Parameter(torch.ones(()))

    def training_step(self, batch: torch.Tensor, batch_idx: int) -> torch.Tensor:
        return self.weight * 1.0

    def on_train_epoch_end(self) -> None:
        self.log("val/abs_rel", self.values[self.current_epoch])

    def configure_optimizers(self) -> torch.optim.Optimizer:
        return torch.optim.SGD(self.parameters(), lr=0.1)


@pytest.mark.parametrize(
    ("values", "best"),
    [
        ([float("nan"), 0.5, 0.4], 0.4),
        ([0.3, float("nan"), 0.4], 0.3),
        ([0.3, -float("inf"), 0.2], 0.2),
        ([float("nan"), float("inf"), float("nan")], None),
    ],
)
def test_the_best_is_a_finite_one(tmp_path: Path, values: list[float], best: float | None) -> None:
    kept = BestCheckpoint(tmp_path / "best.ckpt", "val/abs_rel")
    trainer = Trainer(
        max_epochs=3, accelerator="cpu", logger=False, enable_progress_bar=False,
        enable_model_summary=False, callbacks=[kept],
    )  # fmt: skip
    trainer.fit(Epochs(values), torch.utils.data.DataLoader([torch.ones(1)], batch_size=None))  # type: ignore[arg-type]
    assert (tmp_path / "best.ckpt").exists() == (best is not None)
    if best is not None:
        assert kept.best_model_score is not None
        assert kept.best_model_score.item() == pytest.approx(best)
        assert kept.metrics == {"val/abs_rel": pytest.approx(best)}
        assert torch.load(tmp_path / "best.ckpt", weights_only=True)["epoch"] == values.index(best)


def test_the_best_is_known_in_another_folder(tmp_path: Path) -> None:
    before, after = (BestCheckpoint(tmp_path / name / "best.ckpt", "val/abs_rel") for name in ("a", "b"))
    before.best_model_score, before.metrics = torch.tensor(0.25), {"val/abs_rel": 0.25}
    before.best_model_path = str(before.path)
    before.best_k_models = {str(before.path): torch.tensor(0.25)}
    after.load_state_dict(before.state_dict())
    assert after.best_model_score == 0.25
    assert after.metrics == before.metrics
    assert after.best_model_path == str(tmp_path / "b" / "best.ckpt")
    assert list(after.best_k_models) == [after.best_model_path]
