"""Pictures of a few test frames, and their points for the page of a run."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from lightning import Callback, LightningModule, Trainer
from torch import Tensor

from col3d.batch import Batch, Prediction
from col3d.geometry import angle_between, points_from_depth
from col3d.reports.panel import save_panel
from col3d.reports.scenes import save_frame


class ImagePanels(Callback):
    """Saves panels and points of frames spread evenly over the test set.

    Args:
        folder: where they go.
        count: how many.
    """

    def __init__(self, folder: Path, count: int) -> None:
        self.folder, self.count = folder, count
        self.paths: list[Path] = []

    def on_test_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Choose the frames."""
        frames = len(trainer.datamodule.frames["test"])  # type: ignore[attr-defined]
        self.choose(frames, trainer.global_rank, trainer.world_size)

    def choose(self, frames: int, rank: int = 0, world_size: int = 1) -> None:
        """Choose frames of so many; this process sees every `world_size`-th, from `rank` on."""
        self.paths, self.seen = [], 0
        self.rank, self.world_size = rank, world_size
        self.chosen = set(np.linspace(0, frames - 1, min(self.count, frames)).round().astype(int).tolist())
        self.folder.mkdir(parents=True, exist_ok=True)

    def on_test_batch_end(
        self,
        trainer: Trainer,
        pl_module: LightningModule,
        outputs: Any,
        batch: Any,
        batch_idx: int,
        dataloader_idx: int = 0,
    ) -> None:
        """Draw the chosen frames of a batch; each process draws its own."""
        self.draw(batch, outputs["prediction"], outputs["values"])

    def draw(self, batch: Batch, prediction: Prediction, values: Mapping[str, Tensor]) -> None:
        """Draw the chosen frames of a batch, which follows those drawn before."""
        for i, video in enumerate(batch["video"]):
            if (self.seen + i) * self.world_size + self.rank in self.chosen:
                number = int(batch["frame"][i])
                path = self.folder / f"{video}_{number:04d}.png"
                errors = {name: of_frames[i].item() for name, of_frames in values.items()}
                title = f"{video}, frame {number}: abs_rel {errors['abs_rel']:.3f}"
                if "angle_mean" in errors:
                    title += f", mean angle {errors['angle_mean']:.1f} degrees"
                save_panel(path, _maps(batch, prediction, i), title)
                _save_points(path.with_suffix(".npz"), batch, prediction, i)
                self.paths.append(path)
        self.seen += len(batch["video"])


def _save_points(path: Path, batch: Batch, prediction: Prediction, index: int) -> None:
    """Keep the points of the pixels that count."""
    mask, rays = batch["mask"][index, 0], batch["rays"][index : index + 1]
    truth, guess = (
        points_from_depth(depth[index : index + 1].float(), rays)[0][:, mask].T.cpu().numpy()
        for depth in (batch["depth"], prediction["depth"])
    )
    seen = (batch["image"][index][:, mask].T * 255).round().clamp(0, 255).byte().cpu().numpy()
    save_frame(path, truth, guess, seen)


def _maps(batch: Any, prediction: Any, index: int) -> dict[str, np.ndarray]:
    def picture(values: Tensor) -> np.ndarray:
        array: np.ndarray = values[index].permute(1, 2, 0).detach().float().cpu().numpy()
        return array

    maps = {
        "image": picture(batch["image"]),
        "depth": picture(batch["depth"])[..., 0],
        "depth_pred": picture(prediction["depth"])[..., 0],
        "mask": picture(batch["mask"])[..., 0] > 0,
    }
    if "normals" in prediction:
        maps["normals_pred"] = picture(prediction["normals"])
    if "normals" in prediction and "normals" in batch:
        maps["normals"] = picture(batch["normals"])
        maps["angle"] = picture(angle_between(prediction["normals"].float(), batch["normals"]))[..., 0]
    return maps
