"""Keeps what a network predicts of every test frame."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lightning import Callback, LightningModule, Trainer

from col3d.reports.predictions import PredictionWriter


class SavePredictions(Callback):
    """Writes predictions as files; for one process, in the order of frames.

    Args:
        folder: where they go.
        facts: see `PredictionWriter`.
    """

    def __init__(self, folder: Path, facts: Mapping[str, Any]) -> None:
        self.folder, self.facts = folder, facts
        self.writer: PredictionWriter | None = None

    def on_test_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Begin."""
        self.writer = PredictionWriter(self.folder, self.facts)

    def on_test_batch_end(
        self,
        trainer: Trainer,
        pl_module: LightningModule,
        outputs: Any,
        batch: Any,
        batch_idx: int,
        dataloader_idx: int = 0,
    ) -> None:
        """Add the frames of a batch."""
        assert self.writer is not None
        maps = {
            name: values.movedim(1, -1).float().cpu().numpy()
            for name, values in outputs["prediction"].items()
        }
        for i, (video, frame) in enumerate(zip(batch["video"], batch["frame"].tolist(), strict=True)):
            normals = maps["normals"][i] if "normals" in maps else None
            self.writer.add(video, frame, maps["depth"][i][..., 0], normals)

    def on_test_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Finish."""
        assert self.writer is not None
        self.writer.finish()

    def on_exception(self, trainer: Trainer, pl_module: LightningModule, exception: BaseException) -> None:
        """Leave no file that was begun."""
        if self.writer is not None:
            self.writer.give_up()
