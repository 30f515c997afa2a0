"""Metrics of validation: every registered metric of a task that is measured after each epoch."""

from typing import Any

from torch import Tensor

from col3d.metrics.frame_mean import FrameMean
from col3d.metrics.measure import NONE, Options, measure, registered_specs


class TaskMetrics(FrameMean):
    """Means over frames of the registered metrics of a task, plugins' included.

    Args:
        task: "depth" or "normals".
        options: options of metrics, by their names.
    """

    def __init__(self, task: str, options: Options = NONE, **kwargs: Any) -> None:
        specs = registered_specs(task, validation=True)
        undefined = [name for name, spec in specs.items() if spec.undefined]
        super().__init__(tuple(specs), undefined, **kwargs)
        self.task, self.options = task, options

    def update(self, preds: Tensor, target: Tensor, mask: Tensor) -> None:
        """Add a batch of depth maps (b, 1, h, w) in mm, or of normals (b, 3, h, w)."""
        values = measure(self.task, preds, target, mask, options=self.options, validation=True)
        self.add(values, mask)
