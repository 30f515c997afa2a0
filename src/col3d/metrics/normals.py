"""Mean of the five metrics of normals over frames."""

from typing import Any

from torch import Tensor

from col3d.metrics.frame_mean import FrameMean
from col3d.metrics.functional.normals import NORMAL_METRICS, normal_metrics


class NormalMetrics(FrameMean):
    """Means over frames of `functional.normal_metrics`; `options` go to it."""

    def __init__(self, options: dict[str, float] | None = None, **kwargs: Any) -> None:
        super().__init__(NORMAL_METRICS, **kwargs)
        self.options = options or {}

    def update(self, preds: Tensor, target: Tensor, mask: Tensor) -> None:
        """Add a batch of normals (b, 3, h, w)."""
        self.add(normal_metrics(preds, target, mask, **self.options), mask)
