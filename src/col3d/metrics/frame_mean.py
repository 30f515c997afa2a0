"""Base of metrics: the mean over frames."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import torch
from torch import Tensor
from torchmetrics import Metric


class FrameMean(Metric):
    """Sums of per-frame values and their number, in float64, added over batches and processes.

    Frames of which no pixel counts are left out, and counted in `empty_frames`. Other NaN stays, except for
    metrics that a frame need not have: there it is left out as well.

    Args:
        names: names of the values that each update adds.
        undefined: names of the values that a frame need not have.
    """

    higher_is_better = None
    full_state_update = False
    sums: Tensor
    counted: Tensor
    frames: Tensor
    empty_frames: Tensor

    def __init__(self, names: Sequence[str], undefined: Collection[str] = (), **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.names, self.undefined = tuple(names), frozenset(undefined)
        self.add_state("sums", torch.zeros(len(self.names), dtype=torch.float64), dist_reduce_fx="sum")
        self.add_state("counted", torch.zeros(len(self.names), dtype=torch.int64), dist_reduce_fx="sum")
        self.add_state("frames", torch.zeros((), dtype=torch.int64), dist_reduce_fx="sum")
        self.add_state("empty_frames", torch.zeros((), dtype=torch.int64), dist_reduce_fx="sum")

    def add(self, values: Mapping[str, Tensor], mask: Tensor) -> None:
        """Add a batch: values of shape (b,) by name, and the mask (b, 1, h, w) they were computed under."""
        counts = mask.flatten(1).any(dim=1)
        stacked = torch.stack([values[name].double() for name in self.names])
        may_lack = torch.tensor([name in self.undefined for name in self.names], device=stacked.device)
        having = counts & ~(may_lack[:, None] & stacked.isnan())
        self.sums += torch.where(having, stacked, 0.0).sum(dim=1)
        self.counted += having.sum(dim=1)
        self.frames += counts.sum()
        self.empty_frames += (~counts).sum()

    def update(self, preds: Tensor, target: Tensor, mask: Tensor) -> None:
        """Compute the values of a batch and `add` them."""
        raise TypeError("FrameMean has no metric of its own; use DepthMetrics or NormalMetrics")

    def compute(self) -> dict[str, Tensor]:
        """Means by name; NaN before the first frame that has a value."""
        return dict(zip(self.names, self.sums / self.counted, strict=True))
