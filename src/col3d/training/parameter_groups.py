"""Parameter groups of optimisers, and learning-rate decays over the steps of a training."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from torch import nn
from torch.optim import Optimizer
from torch.optim.lr_scheduler import LambdaLR, LRScheduler

NUMBERED = re.compile(r"((?:[^.]+\.)*?\d+(?:\.\d+)*)\.")
OptimizerFactory = Callable[[nn.Module], Optimizer]
SchedulerFactory = Callable[[Optimizer, int, int], LRScheduler | None]
"""(optimiser, steps of the schedule over the training, epochs) -> schedule; None for a constant rate."""


@dataclass(frozen=True)
class TrainingLength:
    """Length of a training.

    Attributes:
        steps: number of steps of the schedule over the whole training: steps of the optimiser, or epochs if
            it is stepped after epochs.
        epochs: number of epochs of the training.
    """

    steps: int
    epochs: int


def parameter_groups(
    network: nn.Module, weight_decay: float, decoder_weight_decay: float | None
) -> list[dict[str, Any]]:
    """Group the trainable parameters by weight decay: that of the encoder, and that of everything else.

    Args:
        network: its encoder, if any, is its attribute `encoder`.
        weight_decay: weight decay of the encoder.
        decoder_weight_decay: weight decay of everything else; the same when None.
    """
    learning = [p for p in network.parameters() if p.requires_grad]
    if decoder_weight_decay is None:
        return [{"params": learning, "weight_decay": weight_decay}]
    inside = {id(p) for p in getattr(network, "encoder", nn.Module()).parameters()}
    encoder = [p for p in learning if id(p) in inside]
    decoder = [p for p in learning if id(p) not in inside]
    groups = ((encoder, weight_decay), (decoder, decoder_weight_decay))
    return [{"params": parameters, "weight_decay": decay} for parameters, decay in groups if parameters]


def scaled_groups(
    network: nn.Module,
    lr: float,
    weight_decay: tuple[float, float],
    encoder_lr: float | None,
    layer_decay: float | None,
) -> list[dict[str, Any]]:
    """Group the trainable parameters by learning rate: everything but the encoder, then its layers.

    Args:
        network: its encoder, if any, is its attribute `encoder`.
        lr: learning rate of everything but the encoder.
        weight_decay: weight decays of the encoder and of everything else.
        encoder_lr: learning rate of the encoder's last layer; the same as `lr` when None.
        layer_decay: ratio of a layer's rate to that of the layer after it; 1 when None.

    Returns:
        Groups with their `lr`, and `lr_scale`, its ratio to the argument `lr`.

    References:
        Howard, Ruder: Universal Language Model Fine-tuning for Text Classification, ACL 2018, section 3.2;
        Bao et al.: BEiT, ICLR 2022, appendix.
    """
    encoder = getattr(network, "encoder", None)
    layers = layers_of(encoder, layer_decay or 1.0) if isinstance(encoder, nn.Module) else []
    inside = {id(parameter) for parameters, _ in layers for parameter in parameters}
    rest = [p for p in network.parameters() if p.requires_grad and id(p) not in inside]
    first = 1.0 if encoder_lr is None else encoder_lr / lr
    groups = [(rest, weight_decay[1], 1.0)]
    groups += [(parameters, weight_decay[0], first * scale) for parameters, scale in layers]
    return [
        {"params": parameters, "weight_decay": decay, "lr": lr * scale, "lr_scale": scale}
        for parameters, decay, scale in groups
        if parameters
    ]


def layers_of(encoder: nn.Module, layer_decay: float) -> list[tuple[list[nn.Parameter], float]]:
    """List the trainable parameters of an encoder's layers, deepest last, with the scale of their rate.

    A layer begins where the first numbers in the parameters' names change: `blocks.2.0`, `layers.1`.

    >>> [scale for _, scale in layers_of(nn.Sequential(nn.Linear(1, 1), nn.ReLU(), nn.Linear(1, 1)), 0.5)]
    [0.5, 1.0]
    """
    layers: list[list[nn.Parameter]] = [[]]
    current = ""
    for name, parameter in encoder.named_parameters():
        match = NUMBERED.match(name)
        if match and match[1] != current:
            current = match[1]
            layers.append([])
        layers[-1].append(parameter)
    layers = [layer for layer in layers if layer]
    shares = [layer_decay ** (len(layers) - 1 - depth) for depth in range(len(layers))]
    learning = [[parameter for parameter in layer if parameter.requires_grad] for layer in layers]
    return [(layer, share) for layer, share in zip(learning, shares, strict=True) if layer]


def polynomial_decay(
    optimizer: Optimizer, steps: int, power: float, final_ratio: float, hold: float = 0.0
) -> LambdaLR:
    """Decay the learning rate to `final_ratio` of its start over `steps`, as (1 - step / steps) ** power.

    Args:
        optimizer: the optimiser.
        steps: number of steps of the whole training.
        power: exponent; 1 decays linearly.
        final_ratio: ratio of the last rate to the first.
        hold: share of the steps before the decay begins.

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
    """Multiply the learning rate by `factor` after every `period` steps."""
    return LambdaLR(optimizer, lambda step: factor ** (step // period))
