"""Registered terms of a loss: functions of a prediction and its batch.

Each calls one of the pure functions of this package on the maps of prediction and truth that it needs.
"""

from typing import Literal

from torch import Tensor

from col3d.batch import Batch, Prediction, normals_mask
from col3d.geometry import PinholeCamera, normals_from_depth
from col3d.losses import consistency, depth, depth_regression, gradients, normals
from col3d.registry import register_loss

Geometry = Literal["rays", "pinhole"]
NORMALS = ("normals",)
BOTH = ("depth", "normals")


@register_loss("silog")
def silog(prediction: Prediction, batch: Batch) -> Tensor:
    """Scale-invariant logarithmic error of depth."""
    return depth.silog(prediction["depth"], batch["depth"], batch["mask"])


@register_loss("rmse_log")
def rmse_log(prediction: Prediction, batch: Batch) -> Tensor:
    """Root mean squared logarithmic error of depth."""
    return depth_regression.rmse_log(prediction["depth"], batch["depth"], batch["mask"])


@register_loss("depth_l1")
def depth_l1(prediction: Prediction, batch: Batch, max_depth: float) -> Tensor:
    """Mean absolute error of depth that is scaled to [-1, 1], as pix2pix has it."""
    return 2.0 / max_depth * depth_regression.depth_l1(prediction["depth"], batch["depth"], batch["mask"])


@register_loss("gradient_l1")
def gradient_l1(prediction: Prediction, batch: Batch, max_depth: float) -> Tensor:
    """Mean absolute error of the Sobel derivatives of depth that is scaled to [0, 1]."""
    return 1.0 / max_depth * gradients.gradient_l1(prediction["depth"], batch["depth"], batch["mask"])


@register_loss("gradient_direction")
def gradient_direction(prediction: Prediction, batch: Batch) -> Tensor:
    """One minus the cosine between the patterns of the Sobel derivatives of depth."""
    return gradients.gradient_direction(prediction["depth"], batch["depth"], batch["mask"])


@register_loss("normal_l1", needs=NORMALS, truth=NORMALS)
def normal_l1(prediction: Prediction, batch: Batch) -> Tensor:
    """Mean absolute error of the normals' components."""
    return normals.normal_l1(prediction["normals"], batch["normals"], normals_mask(batch))


@register_loss("normal_rmse", needs=NORMALS, truth=NORMALS)
def normal_rmse(prediction: Prediction, batch: Batch) -> Tensor:
    """Root mean squared error of the normals."""
    return normals.normal_rmse(prediction["normals"], batch["normals"], normals_mask(batch))


@register_loss("cross_task_rmse", needs=BOTH)
def cross_task_rmse(prediction: Prediction, batch: Batch, geometry: Geometry = "rays") -> Tensor:
    """Root mean squared difference of predicted normals and those that follow from predicted depth.

    Args:
        prediction: depth and normals.
        batch: frames with rays.
        geometry: how depth becomes normals: `rays` takes those of the batch; `pinhole` is the module of the
            published code: forward differences, and a pinhole, which C3VD's lens is not.
    """
    derived = _derived(prediction["depth"], batch, geometry)
    return consistency.cross_task_rmse(prediction["normals"], derived, batch["mask"])


@register_loss("cross_task_l1", needs=BOTH)
def cross_task_l1(prediction: Prediction, batch: Batch, geometry: Geometry = "rays") -> Tensor:
    """Mean absolute difference of predicted normals and those that follow from predicted depth.

    Args:
        prediction: depth and normals.
        batch: frames with rays.
        geometry: as for `cross_task_rmse`.
    """
    derived = _derived(prediction["depth"], batch, geometry)
    return consistency.cross_task_l1(prediction["normals"], derived, batch["mask"])


def _derived(depth: Tensor, batch: Batch, geometry: Geometry) -> Tensor:
    rays, mask = batch["rays"], batch["mask"]
    if geometry == "rays":
        return normals_from_depth(depth, rays, mask)
    pinhole = PinholeCamera.c3vd_published((depth.shape[-2], depth.shape[-1])).rays().to(rays)
    return normals_from_depth(depth, pinhole, mask, differences="forward")
