"""Who learns with which weight decay, and how fast at each step."""

import math
from collections.abc import Callable
from typing import Any

import pytest
import torch
from torch import nn
from torch.optim.lr_scheduler import LRScheduler

from col3d.training.parameter_groups import parameter_groups, polynomial_decay, step_decay


class Halves(nn.Module):
    """An encoder with a frozen bias, and a decoder."""

    def __init__(self) -> None:
        super().__init__()
        self.encoder, self.decoder = nn.Linear(2, 2), nn.Linear(2, 2)
        self.encoder.bias.requires_grad_(False)


def named(network: nn.Module, groups: list[dict[str, Any]]) -> list[tuple[list[str], float]]:
    names = {id(parameter): name for name, parameter in network.named_parameters()}
    return [([names[id(p)] for p in group["params"]], group["weight_decay"]) for group in groups]


def test_one_weight_decay_makes_one_group_without_what_is_frozen() -> None:
    network = Halves()
    expected = (["encoder.weight", "decoder.weight", "decoder.bias"], 0.1)
    assert named(network, parameter_groups(network, 0.1, None)) == [expected]


def test_another_weight_decay_of_the_decoder_makes_two() -> None:
    network = Halves()
    expected = [(["encoder.weight"], 0.1), (["decoder.weight", "decoder.bias"], 0.0)]
    assert named(network, parameter_groups(network, 0.1, 0.0)) == expected


def test_no_group_is_empty() -> None:
    frozen = Halves()
    frozen.encoder.requires_grad_(False)
    assert named(frozen, parameter_groups(frozen, 0.1, 0.2)) == [(["decoder.weight", "decoder.bias"], 0.2)]
    plain = nn.Linear(2, 2)
    assert named(plain, parameter_groups(plain, 0.1, 0.2)) == [(["weight", "bias"], 0.2)]


def rates(schedule: Callable[[Any], LRScheduler], steps: int) -> list[float]:
    """The learning rate of each step, from a start of 2, and the one after the last."""
    optimizer = torch.optim.SGD([nn.Parameter(torch.zeros(()))], lr=2.0)
    schedules, found = schedule(optimizer), []
    for _ in range(steps + 1):
        found.append(optimizer.param_groups[0]["lr"])
        optimizer.step()
        schedules.step()
    return found


@pytest.mark.parametrize(
    ("power", "final_ratio", "hold"), [(0.9, 0.1, 0.0), (1.0, 0.0, 0.5), (2.0, 0.3, 0.25)]
)
def test_polynomial_decay_equals_its_formula(power: float, final_ratio: float, hold: float) -> None:
    found = rates(lambda optimizer: polynomial_decay(optimizer, 20, power, final_ratio, hold), 20)
    for step, rate in enumerate(found):
        gone = max(0.0, (step / 20 - hold) / (1 - hold))
        assert rate == pytest.approx(2 * (final_ratio + (1 - final_ratio) * math.pow(1 - gone, power)))
    assert found[-1] == pytest.approx(2 * final_ratio)


def test_pix2pix_holds_for_half_of_the_steps_and_falls_in_a_line_to_zero() -> None:
    found = rates(lambda optimizer: polynomial_decay(optimizer, 8, 1.0, 0.0, 0.5), 8)
    assert found == pytest.approx([2, 2, 2, 2, 2, 1.5, 1, 0.5, 0])


def test_polynomial_decay_stays_at_its_end() -> None:
    found = rates(lambda optimizer: polynomial_decay(optimizer, 3, 0.9, 0.1, 0.5), 5)
    assert found[3:] == pytest.approx([0.2] * 3)
    assert found[2] > 0.3


def test_step_decay_falls_after_every_period() -> None:
    found = rates(lambda optimizer: step_decay(optimizer, 3, 0.1), 7)
    assert found == pytest.approx([2, 2, 2, 0.2, 0.2, 0.2, 0.02, 0.02])
