"""Optimisers by name: each of torch and timm takes a step, with its own options, checked."""

from typing import Any

import pytest
import torch
from refusals import refused
from torch import nn

from col3d.errors import OptionError
from col3d.registry import OPTIMIZERS, available, register_optimizer
from col3d.registry.refusals import checked
from col3d.training.optimizers import node, optimizer_of, optimizer_options

COMPILED = ("kron", "kronc", "kronw")
"""Those whose first step compiles code for half a minute."""


class Network(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.encoder = nn.Conv2d(3, 4, 3)
        self.head = nn.Conv2d(4, 1, 3)


def options(name: str, **changes: Any) -> Any:
    return optimizer_options({**node(OPTIMIZERS[name]), **changes})


@pytest.mark.parametrize("name", [name for name in available("optimizer") if name not in COMPILED])
def test_each_takes_a_step_with_its_defaults(name: str) -> None:
    torch.manual_seed(0)
    network = Network()
    before = {key: value.clone() for key, value in network.state_dict().items()}
    optimizer = optimizer_of(options(name))(network)
    for _ in range(2):  # the first of some only measures
        optimizer.zero_grad()
        network.head(network.encoder(torch.rand(2, 3, 9, 9))).square().mean().backward()
        optimizer.step()
    after = network.state_dict()
    assert all(value.isfinite().all() for value in after.values())
    assert not all(torch.equal(value, before[key]) for key, value in after.items())


def test_what_is_here_by_default_is_what_torch_does_with_these_numbers() -> None:
    torch.manual_seed(0)
    ours, theirs = Network(), Network()
    theirs.load_state_dict(ours.state_dict())
    steps = (
        optimizer_of(options("adamw", lr=1e-2, weight_decay=0.1))(ours),
        torch.optim.AdamW(theirs.parameters(), lr=1e-2, weight_decay=0.1),
    )
    image = torch.rand(2, 3, 9, 9)
    for network, optimizer in zip((ours, theirs), steps, strict=True):
        for _ in range(3):
            optimizer.zero_grad()
            network.head(network.encoder(image)).square().mean().backward()
            optimizer.step()
    for one, other in zip(ours.parameters(), theirs.parameters(), strict=True):
        assert torch.equal(one, other)


def test_the_rest_has_a_weight_decay_of_its_own() -> None:
    groups = optimizer_of(options("lion", weight_decay=0.1, decoder_weight_decay=0.0))(Network()).param_groups
    assert [(group["weight_decay"], len(group["params"])) for group in groups] == [(0.1, 2), (0.0, 2)]


@pytest.mark.parametrize(
    ("name", "changes", "about", "named"),
    [
        ("adamw", {"betas": [1.0, 0.9]}, "optimizer", ("adamw: ", "index 0: 1.0")),
        ("sgd", {"nesterov": True, "momentum": 0.0}, "optimizer", ("sgd: ", "Nesterov")),
        ("rprop", {"decoder_weight_decay": 0.1}, "optimizer.decoder_weight_decay", ("rprop",)),
    ],
)
def test_rules_of_the_library_are_one_line(
    name: str, changes: dict[str, Any], about: str, named: tuple[str, ...]
) -> None:
    with refused(OptionError, about, *named):
        options(name, **changes)


@pytest.mark.parametrize(
    ("name", "given", "about", "named"),
    [
        ("adamw", {"lr": -1}, "optimizer.lr", ("greater than 0", -1)),
        ("adamw", {"weight_decay": -1.0}, "optimizer.weight_decay", ("or equal to 0", -1.0)),
        ("adamw", {"eps": 0.0}, "optimizer.eps", ("greater than 0", 0.0)),
        ("sgd", {"momentum": 1.0}, "optimizer.momentum", ("less than 1", 1.0)),
        ("adamw", {"momentum": 0.9}, "optimizer.momentum", ("no such option",)),
        ("lion", {"betas": [0.9]}, "optimizer.betas.1", ("needed",)),
        ("radam", {"eps": "small"}, "optimizer.eps", ("number", "'small'")),
    ],
)
def test_values_are_held_against_the_signature(
    name: str, given: dict[str, Any], about: str, named: tuple[object, ...]
) -> None:
    with refused(OptionError, about, *named):
        checked(
            OPTIMIZERS[name].options(type(options(name)).__mro__[1]), {"name": name, **given}, "optimizer"
        )


def test_an_unknown_name_has_a_nearest_one() -> None:
    with refused(OptionError, "optimizer.name", "'adanw2'", "'adanw'"):
        optimizer_options({"name": "adanw2"})


def test_an_error_of_somebody_s_optimiser_is_not_ours() -> None:
    class Mine(torch.optim.SGD):
        def __init__(self, params: Any, lr: float = 1e-3, odd: int = 1) -> None:
            raise ValueError(f"odd is {odd}")

    register_optimizer("mine", Mine)
    with refused(ValueError, None, "odd is 3") as error:
        optimizer_options({"name": "mine", "odd": 3})
    assert not isinstance(error.value, OptionError)
