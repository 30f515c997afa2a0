"""Means and counts over an epoch that a checkpoint can hold in its middle."""

from collections.abc import Callable, Mapping
from typing import Any

import torch
from torch import Tensor

Reduce = Callable[[Tensor], Tensor]
"""Sum over all processes."""


class EpochTotals:
    """Weighted means of named numbers, and counts, in float64 on the device of what is added."""

    def __init__(self) -> None:
        self.sums: dict[str, Tensor] = {}
        """By name: sum of value times weight, and sum of weights, which is 0 for a count."""

    def reset(self) -> None:
        """Begin again."""
        self.sums = {}

    def add(self, values: Mapping[str, Tensor], weight: int) -> None:
        """Add values to means."""
        for name, value in values.items():
            scaled = value.detach().double() * weight
            self._add(name, torch.stack([scaled, torch.full_like(scaled, weight)]))

    def count(self, name: str, number: Tensor) -> None:
        """Add to a count."""
        self._add(name, torch.stack([number.double(), torch.zeros_like(number, dtype=torch.float64)]))

    def compute(self, reduce: Reduce) -> dict[str, Tensor]:
        """Means and counts over all processes, in float32."""
        totals = {name: reduce(sums) for name, sums in self.sums.items()}
        return {
            name: torch.where(weight > 0, total / weight, total).float()
            for name, (total, weight) in totals.items()
        }

    def state(self, reduce: Reduce) -> dict[str, Any]:
        """What to keep, over all processes: plain tensors."""
        return {name: reduce(sums).cpu() for name, sums in self.sums.items()}

    def load(self, state: Mapping[str, Tensor], first: bool, device: torch.device) -> None:
        """Take up what was kept, on the device that processes reduce on; the first of them has it all."""
        kept = {name: sums.to(device) for name, sums in state.items()}
        self.sums = kept if first else {name: torch.zeros_like(sums) for name, sums in kept.items()}

    def _add(self, name: str, one: Tensor) -> None:
        self.sums[name] = self.sums[name] + one if name in self.sums else one
