"""Means and counts over an epoch, which a checkpoint within the epoch can save."""

from collections.abc import Callable, Mapping
from typing import Any

import torch
from torch import Tensor

Reduce = Callable[[Tensor], Tensor]
"""Function that sums a tensor over all processes."""


class EpochTotals:
    """Weighted means of named numbers, and counts, in float64 on the device of the added values."""

    def __init__(self) -> None:
        self.sums: dict[str, Tensor] = {}
        """Sum of value times weight, and sum of weights (0 for a count), by name."""

    def reset(self) -> None:
        """Forget all sums."""
        self.sums = {}

    def add(self, values: Mapping[str, Tensor], weight: int) -> None:
        """Add values to the means of their names."""
        for name, value in values.items():
            scaled = value.detach().double() * weight
            self._add(name, torch.stack([scaled, torch.full_like(scaled, weight)]))

    def count(self, name: str, number: Tensor) -> None:
        """Add a number to a count."""
        self._add(name, torch.stack([number.double(), torch.zeros_like(number, dtype=torch.float64)]))

    def compute(self, reduce: Reduce) -> dict[str, Tensor]:
        """Compute means and counts over all processes, in float32."""
        totals = {name: reduce(sums) for name, sums in self.sums.items()}
        return {
            name: torch.where(weight > 0, total / weight, total).float()
            for name, (total, weight) in totals.items()
        }

    def state(self, reduce: Reduce) -> dict[str, Any]:
        """Return the sums over all processes, as plain tensors for a checkpoint."""
        return {name: reduce(sums).cpu() for name, sums in self.sums.items()}

    def load(self, state: Mapping[str, Tensor], first: bool, device: torch.device) -> None:
        """Restore saved sums on the device of reductions; only the first process receives them."""
        kept = {name: sums.to(device) for name, sums in state.items()}
        self.sums = kept if first else {name: torch.zeros_like(sums) for name, sums in kept.items()}

    def _add(self, name: str, one: Tensor) -> None:
        self.sums[name] = self.sums[name] + one if name in self.sums else one
