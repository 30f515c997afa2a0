"""Depth and normal metrics as torchmetrics: each frame weighs the same, under any batches and processes."""

from col3d.metrics.depth import DepthMetrics
from col3d.metrics.frame_mean import FrameMean
from col3d.metrics.normals import NormalMetrics
from col3d.metrics.protocol import Protocol

__all__ = ["DepthMetrics", "FrameMean", "NormalMetrics", "Protocol"]
