"""Mean of the nine depth metrics over frames."""

from typing import Any

from torch import Tensor

from col3d.metrics.frame_mean import FrameMean
from col3d.metrics.functional.depth import DEPTH_METRICS, depth_metrics


class DepthMetrics(FrameMean):
    """Means over frames of `functional.depth_metrics`; `options` go to it."""

    def __init__(self, options: dict[str, float] | None = None, **kwargs: Any) -> None:
        super().__init__(DEPTH_METRICS, **kwargs)
        self.options = options or {}

    def update(self, preds: Tensor, target: Tensor, mask: Tensor) -> None:
        """Add a batch of depth maps (b, 1, h, w) in mm."""
        self.add(depth_metrics(preds, target, mask, **self.options), mask)
