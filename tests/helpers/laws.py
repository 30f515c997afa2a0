"""Laws that losses of maps have in common, each asserted by a function, and maps to try them on."""

from collections.abc import Callable

import pytest
import torch
from torch import Tensor

Loss = Callable[[Tensor, Tensor, Tensor], Tensor]
"""A loss of (preds, target, mask)."""


def depth_maps(masked: float) -> tuple[Tensor, Tensor, Tensor]:
    """Predicted and true depth of 2 to 82 mm, and a mask that leaves out about that share of the pixels."""
    generator = torch.Generator().manual_seed(0)
    preds, target = (torch.rand(2, 1, 13, 17, generator=generator) * 80 + 2 for _ in range(2))
    return preds, target, torch.rand(2, 1, 13, 17, generator=generator) > masked


def cost_and_gradient(loss: Loss, preds: Tensor, target: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
    preds = preds.clone().requires_grad_()
    found = loss(preds, target, mask)
    found.backward()
    assert preds.grad is not None
    return found, preds.grad


def costs_nothing(loss: Loss, preds: Tensor, target: Tensor, mask: Tensor) -> None:
    """Neither a loss nor a gradient."""
    found, gradient = cost_and_gradient(loss, preds, target, mask)
    assert found.item() == 0
    assert (gradient == 0).all()


def costs_nothing_at_truth(loss: Loss, target: Tensor, mask: Tensor) -> None:
    costs_nothing(loss, target, target, mask)


def masked_is_inert(
    loss: Loss, preds: Tensor, target: Tensor, mask: Tensor, junk: float
) -> tuple[Tensor, Tensor]:
    """Junk where masked changes nothing and gets no gradient. Returns those of preds and target."""
    ours, theirs = (torch.where(mask, values, junk).requires_grad_() for values in (preds, target))
    found = loss(ours, theirs, mask)
    found.backward()
    assert torch.equal(found, loss(preds, target, mask))
    assert ours.grad is not None
    assert theirs.grad is not None
    for gradient in (ours.grad, theirs.grad):
        assert (gradient[~mask.expand_as(gradient)] == 0).all()
        assert gradient.isfinite().all()
    return ours.grad, theirs.grad


def half_precision_is_close(
    loss: Loss, half: Tensor, target: Tensor, mask: Tensor, expected: float, rel: float
) -> None:
    """The loss of predictions in half precision is computed in float32, and its gradient is finite."""
    found, gradient = cost_and_gradient(loss, half, target, mask)
    assert found.dtype == torch.float32
    assert found.item() == pytest.approx(expected, rel=rel)
    assert gradient.isfinite().all()


def depth_of_nothing_is_finite(loss: Loss, preds: Tensor, target: Tensor, low: float) -> None:
    preds = preds.clone()
    preds[0, 0, 0, :5] = low
    found, gradient = cost_and_gradient(loss, preds, target, torch.ones_like(preds, dtype=torch.bool))
    assert found.isfinite()
    assert gradient.isfinite().all()


def gradient_is_that_of_finite_differences(loss: Loss, preds: Tensor, target: Tensor, mask: Tensor) -> None:
    preds, target = preds.double().requires_grad_(), target.double()
    assert torch.autograd.gradcheck(lambda p: loss(p, target, mask), (preds,))
