"""Weighted sum of the terms of a loss."""

import functools
from collections.abc import Callable, Mapping, Sequence
from inspect import signature
from typing import Any, TypeVar

import torch
from torch import Tensor, nn

from col3d.batch import Batch, Prediction
from col3d.errors import OptionError, UserError
from col3d.losses.balance import Balancer, Fixed
from col3d.losses.options import TermOptions, own_options, term_options
from col3d.registry import LOSSES

Number = TypeVar("Number", int, float)
Term = Callable[[Prediction, Batch], Tensor]


class WeightedLoss(nn.Module):
    """total = sum of lambda * term over named terms, in their order.

    Args:
        lambdas: one weight for each term, in the order of the terms.
        terms: terms by name, each a function of (prediction, batch), or the name of a registered term, alone
            or with its options and the epoch from which it counts: `{"term": "silog", "from_epoch": 4}`.
        max_depth: depth in mm that terms scale depth by.
        balance: how terms and lambdas become one number; the weighted sum when absent.

    Raises:
        OptionError: an unknown term or option, or not one weight for each term.

    >>> WeightedLoss([0.5, 0.5], {"depth": "silog", "normals": "normal_l1"}).formula
    '0.5 silog + 0.5 normal_l1'
    """

    def __init__(
        self,
        lambdas: Sequence[float],
        terms: Mapping[str, Term | str | Mapping[str, Any] | TermOptions],
        max_depth: float = 100.0,
        balance: Balancer | None = None,
    ) -> None:
        super().__init__()
        self.balance = balance or Fixed()
        if len(lambdas) != len(terms):
            raise OptionError(
                f"loss.lambdas: expected {len(terms)} number(s) ({', '.join(terms)}), got {len(lambdas)}: "
                f"{list(lambdas)}"
            )
        self.lambdas = dict(zip(terms, lambdas, strict=True))
        self.terms: dict[str, Term] = {}
        self.from_epoch: dict[str, int] = {}
        parts = []
        for name, given in terms.items():
            if callable(given):
                self.terms[name], self.from_epoch[name] = given, 0
                parts.append(f"{self.lambdas[name]:g} {name}")
            else:
                options = term_options(given)
                self.terms[name], self.from_epoch[name] = _bound(options, max_depth), options.from_epoch
                parts.append(f"{self.lambdas[name]:g} {options}")
        self.formula = " + ".join(parts)

    def forward(self, prediction: Prediction, batch: Batch, epoch: int | None = None) -> dict[str, Tensor]:
        """Every term unweighted, and as `total` the weighted sum of those that count in this epoch."""
        with torch.autocast(batch["image"].device.type, enabled=False):
            losses = {
                name: _scalar(f"loss.terms.{name}", term(prediction, batch))
                for name, term in self.terms.items()
            }
            weights = {name: self._weight(name, epoch) for name in losses}
            losses["total"] = _scalar("loss.balance", self.balance(losses, weights))
        return losses

    def _weight(self, name: str, epoch: int | None) -> float:
        # Zero rather than left out: under DDP every prediction has to have a gradient.
        return self.lambdas[name] if epoch is None or epoch >= self.from_epoch[name] else 0.0


def _scalar(option: str, value: object) -> Tensor:
    """Check that the result of a term or a balancer is a scalar, and return it.

    Raises:
        UserError: it is no scalar; the message names the option.
    """
    if isinstance(value, Tensor) and value.ndim == 0:
        return value
    actual = f"shape {tuple(value.shape)}" if isinstance(value, Tensor) else type(value).__name__
    raise UserError(f"{option}: its function has to return a tensor that is one number; got {actual}")


def _bound(options: TermOptions, max_depth: float) -> Term:
    """Bind a registered term to its options, and to the maximum depth if it has that parameter."""
    part = LOSSES[options.term]
    supplied = {"max_depth": max_depth} if "max_depth" in signature(part.build).parameters else {}
    return functools.partial(part.build, **own_options(options), **supplied)
