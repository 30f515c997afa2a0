"""Which parameters learn how, and learning rates over the steps of a training."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from torch import nn
from torch.optim import Optimizer
from torch.optim.lr_scheduler import LambdaLR, LRScheduler

OptimizerFactory = Callable[[nn.Module], Optimizer]
SchedulerFactory = Callable[[Optimizer, int, int], LRScheduler | None]
"""(optimiser, steps of the schedule over the training, epochs) -> schedule; None for a constant rate."""


@dataclass(frozen=True)
class TrainingLength:
    """How long a training is.

    Attributes:
        steps: of the schedule over the whole training: of the optimiser, or epochs where it is stepped after
            those.
        epochs: of the training.
    """

    steps: int
    epochs: int


def parameter_groups(
    network: nn.Module, weight_decay: float, decoder_weight_decay: float | None
) -> list[dict[str, Any]]:
    """The parameters that learn, with the weight decay of the encoder and that of everything else.

    Args:
        network: its encoder, where it has one, is its attribute `encoder`.
        weight_decay: of the encoder.
        decoder_weight_decay: of everything else; the same when None.
    """
    learning = [p for p in network.parameters() if p.requires_grad]
    if decoder_weight_decay is None:
        return [{"params": learning, "weight_decay": weight_decay}]
    inside = {id(p) for p in getattr(network, "encoder", nn.Module()).parameters()}
    encoder = [p for p in learning if id(p) in inside]
    decoder = [p for p in learning if id(p) not in inside]
    groups = ((encoder, weight_decay), (decoder, decoder_weight_decay))
    return [{"params": parameters, "weight_decay": decay} for parameters, decay in groups if parameters]


def polynomial_decay(
    optimizer: Optimizer, steps: int, power: float, final_ratio: float, hold: float = 0.0
) -> LambdaLR:
    """Learning rate that falls to `final_ratio` of its start over `steps`, as (1 - step / steps) ** power.

    Args:
        optimizer: whose rates are changed.
        steps: of the whole training.
        power: 1 falls in a straight line.
        final_ratio: share of the first rate that is left in the end.
        hold: share of the steps before the rate begins to fall.

    References:
        Lee et al.: From Big to Small: Multi-Scale Local Planar Guidance for Monocular Depth Estimation
        (BTS), 2019, section 4.2: power 0.9, down to a tenth.
    """
    held = hold * steps

    def ratio(step: int) -> float:
        gone = max(0.0, min(step, steps) - held) / max(steps - held, 1.0)
        remaining: float = (1 - gone) ** power
        return final_ratio + (1 - final_ratio) * remaining

    return LambdaLR(optimizer, ratio)


def step_decay(optimizer: Optimizer, period: int, factor: float) -> LambdaLR:
    """Learning rate times `factor` after every `period` steps."""
    return LambdaLR(optimizer, lambda step: factor ** (step // period))
