"""Losses: pure functions of (preds, target, mask) to a scalar; registered terms, and their weighted sum.

All compute in float32 at least, are zero at the truth, and pass no gradient to masked pixels.
"""

from col3d.losses.adversarial import gan_loss
from col3d.losses.consistency import cross_task_l1, cross_task_rmse
from col3d.losses.depth import silog
from col3d.losses.depth_regression import depth_l1, rmse_log
from col3d.losses.gradients import gradient_direction, gradient_l1
from col3d.losses.normals import normal_l1, normal_rmse
from col3d.losses.weighted import WeightedLoss

__all__ = [
    "WeightedLoss",
    "cross_task_l1",
    "cross_task_rmse",
    "depth_l1",
    "gan_loss",
    "gradient_direction",
    "gradient_l1",
    "normal_l1",
    "normal_rmse",
    "rmse_log",
    "silog",
]
