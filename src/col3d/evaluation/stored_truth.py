"""Ground truth of a split stored beside predictions, for figures that are drawn without torch."""

from pathlib import Path

import numpy as np
import torch

from col3d.data.build import full_frames, sized_frames
from col3d.data.datasets.c3vd import C3VD
from col3d.data.options import DataOptions
from col3d.io.predictions import PredictionWriter, read_facts
from col3d.phantom.options import PhantomOptions


def keep_truth(folder: Path, data: DataOptions, phantom: PhantomOptions, max_depth: float) -> None:
    """Store images, depth and normals of the test split at the network's size, unless stored already.

    Args:
        folder: folder for the files; see `col3d.io.predictions`.
        data: data set of the test split, and the size.
        phantom: options of rendered data.
        max_depth: the largest depth in mm that the files can hold.
    """
    facts = {
        "max_depth": max_depth,
        "data": [data.tested.name, str(Path(data.tested.root).absolute()), data.size],
        "split": ["test", data.tested.split.test],
    }
    kept = read_facts(folder)
    if kept is not None and {name: kept.get(name) for name in facts} == facts:
        return
    resized = sized_frames(data.tested, phantom, "test", data.size)
    has_files = Path(data.tested.root).is_dir()  # a store works without them, but has no occlusion
    frames = full_frames(data.tested, phantom, "test") if has_files else None
    rays = resized[0]["rays"]
    off_axis = torch.rad2deg(torch.atan2(rays[:2].norm(dim=0), rays[2]))
    writer = PredictionWriter(folder, {**facts, "off_axis": off_axis.round(decimals=2).tolist()})
    for index in range(len(resized)):
        item = resized[index]
        normals = item["normals"].movedim(0, -1).numpy() if "normals" in item else None
        image = item["image"].movedim(0, -1).numpy()
        hidden = frames.occlusion(index) if isinstance(frames, C3VD) else None
        occlusion = None if hidden is None else _shrunk(hidden, data.size)
        depth = item["depth"][0].numpy()
        writer.add(item["video"], int(item["frame"]), depth, normals, image, occlusion)
    writer.finish()


def _shrunk(mask: torch.Tensor, size: list[int]) -> np.ndarray:
    """Resize a mask by its nearest pixels: (1, h, w) -> (h2, w2)."""
    shrunk = torch.nn.functional.interpolate(mask[None].float(), size=size, mode="nearest-exact")
    resized: np.ndarray = (shrunk[0, 0] > 0).numpy()
    return resized
