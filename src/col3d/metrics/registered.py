"""Registration of this package's metrics; functions that compute several are called once."""

from jaxtyping import Bool, Float
from torch import Tensor

from col3d.metrics.functional.boundary import boundary_f1
from col3d.metrics.functional.depth import delta_share, depth_errors
from col3d.metrics.functional.literature import literature_errors
from col3d.metrics.functional.normals import normal_errors
from col3d.metrics.functional.ranges import range_errors
from col3d.registry import register_metrics
from col3d.registry.metric_specs import (
    BOUNDARY_F1,
    DELTA_1_1,
    DEPTH_RANGES,
    FURTHER_NORMALS,
    LITERATURE,
    MAE,
    PAPER_DEPTH,
    PAPER_NORMALS,
)

register_metrics((*PAPER_DEPTH, MAE), depth_errors)
register_metrics((*PAPER_NORMALS, *FURTHER_NORMALS), normal_errors)
register_metrics(DEPTH_RANGES, range_errors)
register_metrics((BOUNDARY_F1,), boundary_f1)
register_metrics(LITERATURE, literature_errors)


def delta_1_1(
    preds: Float[Tensor, "b 1 h w"], target: Float[Tensor, "b 1 h w"], mask: Bool[Tensor, "b 1 h w"]
) -> Float[Tensor, " b"]:
    """Share of the counting pixels within a factor of 1.1."""
    return delta_share(preds, target, mask, 1.1)


register_metrics((DELTA_1_1,), delta_1_1)
