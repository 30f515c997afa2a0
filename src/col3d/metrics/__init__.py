"""Depth and normal metrics as torchmetrics: each frame weighs the same in any batches and processes."""

from col3d.metrics.depth import DepthMetrics
from col3d.metrics.frame_mean import FrameMean
from col3d.metrics.measure import registered_specs
from col3d.metrics.normals import NormalMetrics
from col3d.metrics.protocol import Protocol
from col3d.metrics.task_metrics import TaskMetrics

__all__ = ["DepthMetrics", "FrameMean", "NormalMetrics", "Protocol", "TaskMetrics", "registered_specs"]
