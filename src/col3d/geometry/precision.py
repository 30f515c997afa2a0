"""What has to be exact is computed in float32 at least."""

import torch
from torch import Tensor


def at_least_float32(x: Tensor) -> Tensor:
    """Half precision widened; float32 and float64 stay."""
    return x.to(torch.promote_types(x.dtype, torch.float32))
