"""Parameter groups of optimisers: weight decay, and learning rates that decay by layer."""

import re
from collections.abc import Callable
from typing import Any

from torch import nn
from torch.optim import Optimizer

NUMBERED = re.compile(r"((?:[^.]+\.)*?\d+(?:\.\d+)*)\.")
OptimizerFactory = Callable[[nn.Module], Optimizer]


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
