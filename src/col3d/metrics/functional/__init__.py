"""Metrics as pure functions of (preds, target, mask): one value a frame."""

from col3d.metrics.functional.boundary import boundary_f1
from col3d.metrics.functional.depth import DEPTH_METRICS, depth_metrics
from col3d.metrics.functional.normals import NORMAL_METRICS, normal_metrics

__all__ = ["DEPTH_METRICS", "NORMAL_METRICS", "boundary_f1", "depth_metrics", "normal_metrics"]
