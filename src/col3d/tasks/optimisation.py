"""Learning rates over the steps of a training."""

from collections.abc import Callable

from torch.optim import Optimizer
from torch.optim.lr_scheduler import LambdaLR

OptimizerFactory = Callable[[list[dict[str, object]]], Optimizer]


def polynomial_decay(optimizer: Optimizer, steps: int, power: float, final_ratio: float) -> LambdaLR:
    """Learning rate that falls to `final_ratio` of its start over `steps`, as (1 - step / steps) ** power.

    References:
        Lee et al.: From Big to Small: Multi-Scale Local Planar Guidance for Monocular Depth Estimation
        (BTS), 2019, section 4.2: power 0.9, down to a tenth.
    """

    def ratio(step: int) -> float:
        remaining: float = (1 - min(step, steps) / steps) ** power
        return final_ratio + (1 - final_ratio) * remaining

    return LambdaLR(optimizer, ratio)
