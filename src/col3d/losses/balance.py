"""Balancers: combine the terms of a loss into the scalar that is minimised."""

from collections.abc import Callable, Mapping

import torch
from torch import Tensor, nn

from col3d.registry import register_balancer

Balancer = Callable[[Mapping[str, Tensor], Mapping[str, float]], Tensor]
"""(terms of a batch, their lambdas) -> the scalar that is minimised."""


@register_balancer("fixed")
class Fixed(nn.Module):
    """The sum of the terms times their lambdas, as they are."""

    def forward(self, losses: Mapping[str, Tensor], lambdas: Mapping[str, float]) -> Tensor:
        """Scalars by name, and a weight for each; a weight of 0 is a term that does not count yet."""
        return torch.stack([lambdas[name] * loss for name, loss in losses.items()]).sum()
