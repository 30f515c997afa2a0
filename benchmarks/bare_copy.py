"""A floor for loaders: the bytes of a store's rows copied out of a memory map, and nothing else."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import Dataset

from col3d.data.sized import collated

ARRAYS = {"image": np.uint8, "depth": np.int16, "normals": np.int16, "mask": np.bool_}


class BareCopy(Dataset[dict[str, Any]]):
    """Rows of `.npy` files, copied and collated as frames of files are; it knows nothing of what they mean.

    Args:
        videos: folder and number of rows of each.
    """

    def __init__(self, videos: Sequence[tuple[Path, int]]) -> None:
        self.maps = [
            {name: np.load(folder / f"{name}.npy", mmap_mode="r") for name in ARRAYS} for folder, _ in videos
        ]
        self.places = [(video, row) for video, (_, rows) in enumerate(videos) for row in range(rows)]

    def __len__(self) -> int:
        return len(self.places)

    def __getitem__(self, index: int) -> dict[str, Any]:
        video, row = self.places[index]
        return {name: np.copy(values[row]) for name, values in self.maps[video].items()}

    def __getitems__(self, indices: Sequence[int]) -> dict[str, Any]:
        """Rows as one batch."""
        return dict(collated([self._as_tensors(index) for index in indices]))

    def _as_tensors(self, index: int) -> dict[str, Tensor]:
        rows = self[index]
        return {name: torch.from_numpy(rows[name].view(dtype)) for name, dtype in ARRAYS.items()}
