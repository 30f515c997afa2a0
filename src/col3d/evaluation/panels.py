"""Pictures of a few scored frames, and their 3D points for the page of a run."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from torch import Tensor

from col3d.batch import Batch, Prediction
from col3d.geometry import angle_between, points_from_depth
from col3d.io.ownership import Owned
from col3d.reports.panel import save_panel
from col3d.reports.scenes import save_frame


class ImagePanels:
    """Keeps frames spread evenly over the scored ones, and draws them and their points on request.

    Args:
        folder: folder of the run or evaluation; pictures go into its folder `panels`.
        kind: kind of the output; see `Owned`.
        count: number of frames to keep.

    Attributes:
        paths: paths of the drawn pictures.
    """

    def __init__(self, folder: Path, kind: str, count: int) -> None:
        self.folder, self.kind, self.count = folder, kind, count
        self.paths: list[Path] = []
        self.choose(0)

    def choose(self, frames: int, rank: int = 0, world_size: int = 1) -> None:
        """Choose which of so many frames to keep; this process sees every `world_size`-th, from `rank` on."""
        self.paths, self.seen, self.kept = [], 0, list[_Kept]()
        self.rank, self.world_size = rank, world_size
        self.chosen = set(np.linspace(0, frames - 1, min(self.count, frames)).round().astype(int).tolist())

    def keep(self, batch: Batch, prediction: Prediction, values: Mapping[str, Tensor]) -> None:
        """Keep the chosen frames of the next batch."""
        for i in range(len(batch["video"])):
            if (self.seen + i) * self.world_size + self.rank in self.chosen:
                self.kept.append(tuple(_one(given, i) for given in (batch, prediction, values)))
        self.seen += len(batch["video"])

    def clear(self) -> None:
        """Remove pictures of an earlier scoring."""
        Owned(self.folder, self.kind, "panels").remove(below="panels/")

    def draw(self) -> None:
        """Draw the kept frames.

        Raises:
            UserError: a file of others has the name of a picture.
        """
        owned = Owned(self.folder, self.kind, "panels")
        for batch, prediction, values in self.kept:
            name = f"panels/{batch['video'][0]}_{int(batch['frame'][0]):04d}"
            owned.claim(f"{name}.png", f"{name}.npz")
            path = self.folder / f"{name}.png"
            path.parent.mkdir(parents=True, exist_ok=True)
            save_panel(path, _maps(batch, prediction, 0), _title(batch, values))
            if batch["mask"].any():
                _save_points(path.with_suffix(".npz"), batch, prediction, 0)
            self.paths.append(path)


_Kept = tuple[Any, ...]
"""Batch, prediction and metrics of one frame."""


def _one(given: Mapping[str, Any], index: int) -> dict[str, Any]:
    """Return a frame of a batch as a batch of one, on the CPU."""
    own = {key: values[index : index + 1] for key, values in given.items()}
    return {
        key: values.detach().cpu() if isinstance(values, Tensor) else values for key, values in own.items()
    }


def _title(batch: Batch, values: Mapping[str, Tensor]) -> str:
    where = f"{batch['video'][0]}, frame {int(batch['frame'][0])}"
    if not batch["mask"].any():
        return f"{where}: no valid depth"
    title = f"{where}: abs_rel {values['abs_rel'].item():.3f}"
    if "angle_mean" in values:
        title += f", mean angle {values['angle_mean'].item():.1f} degrees"
    return title


def _save_points(path: Path, batch: Batch, prediction: Prediction, index: int) -> None:
    """Save the true and predicted points of the pixels in the mask, with their colours."""
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
