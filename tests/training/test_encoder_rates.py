"""Rates of an encoder and of its layers, and an encoder that learns from an epoch on."""

from typing import Any

import pytest
import torch
from refusals import refused
from torch import nn

from col3d.errors import OptionError
from col3d.layers.freeze import check_learns
from col3d.models import create
from col3d.models.options import model_options
from col3d.registry import OPTIMIZERS
from col3d.training.optimizers import check_encoder, node, optimizer_of, optimizer_options
from col3d.training.parameter_groups import layers_of
from col3d.training.schedulers import scheduler_of, scheduler_options


class Network(nn.Module):
    """Three layers that are numbered, behind a stem; and a head."""

    def __init__(self) -> None:
        super().__init__()
        self.encoder = nn.ModuleDict(
            {"stem": nn.Linear(1, 1), "blocks": nn.ModuleList(nn.Linear(1, 1) for _ in range(3))}
        )
        self.head = nn.Linear(1, 1)


def options(name: str = "adamw", **changes: Any) -> Any:
    return optimizer_options({**node(OPTIMIZERS[name]), **changes})


def rates(network: nn.Module, **changes: Any) -> dict[str, tuple[float, float]]:
    """Rate and weight decay of each parameter."""
    groups = optimizer_of(options(**changes))(network).param_groups
    names = {id(parameter): name for name, parameter in network.named_parameters()}
    return {
        names[id(p)]: (group["lr"], group.get("weight_decay", 0.0))
        for group in groups
        for p in group["params"]
    }


def test_each_layer_has_a_share_of_the_rate_of_the_next() -> None:
    found = rates(Network(), lr=0.8, layer_decay=0.5, weight_decay=0.1, decoder_weight_decay=0.2)
    weights = {name.removesuffix(".weight"): rate for name, rate in found.items() if name.endswith("weight")}
    assert weights == {
        "head": (0.8, 0.2),
        "encoder.stem": (0.1, 0.1),
        "encoder.blocks.0": (0.2, 0.1),
        "encoder.blocks.1": (0.4, 0.1),
        "encoder.blocks.2": (0.8, 0.1),
    }
    assert {name.replace("bias", "weight"): rate for name, rate in found.items()} == {
        name: rate for name, rate in found.items() if name.endswith("weight")
    }


def test_an_encoder_has_a_rate_of_its_own() -> None:
    found = rates(Network(), lr=1e-3, encoder_lr=1e-4)
    assert {name: rate for name, (rate, _) in found.items() if name.startswith("head")} == {
        "head.weight": 1e-3,
        "head.bias": 1e-3,
    }
    [rate] = {rate for name, (rate, _) in found.items() if name.startswith("encoder")}
    assert rate == pytest.approx(1e-4, rel=1e-12)
    both = rates(Network(), lr=1e-3, encoder_lr=1e-4, layer_decay=0.1)
    assert both["encoder.blocks.2.weight"][0] == pytest.approx(1e-4)
    assert both["encoder.stem.weight"][0] == pytest.approx(1e-7)


@pytest.mark.parametrize("name", ["adam", "lion", "rprop", "lamb"])
def test_any_optimiser_takes_a_step_with_them(name: str) -> None:
    network = Network()
    optimizer = optimizer_of(options(name, encoder_lr=1e-4, layer_decay=0.5))(network)
    schedule = scheduler_of(scheduler_options({"name": "OneCycleLR", "max_lr": 0.1, "cycle_momentum": False}))
    schedule(optimizer, 4, 1)
    scales = [group["lr_scale"] for group in optimizer.param_groups]
    assert [group["max_lr"] for group in optimizer.param_groups] == pytest.approx([0.1 * s for s in scales])
    sum(parameter.sum() for parameter in network.parameters()).backward()
    optimizer.step()


@pytest.mark.parametrize("name", ["bts", "newcrfs", "monodepth_fpn", "pix2pix"])
def test_networks_here_have_layers(name: str) -> None:
    given = {"bts": {"encoder": "resnet18"}, "monodepth_fpn": {"encoder": "lcnet_035"}}.get(name, {})
    network: Any = create(name, **given)
    layers = layers_of(network.encoder, 0.9)
    assert len(layers) > 2
    assert sum(len(layer) for layer, _ in layers) == len(list(network.encoder.parameters()))
    assert [share for _, share in layers] == sorted({share for _, share in layers})
    check_encoder(options(layer_decay=0.9), network)


@pytest.mark.parametrize("changes", [{"encoder_lr": 1e-3}, {"layer_decay": 0.9}])
def test_a_network_without_an_encoder_is_told_what_is_needed(changes: dict[str, float]) -> None:
    [option] = changes
    with refused(OptionError, f"optimizer.{option}", "Linear ", "`encoder`"):
        check_encoder(options(**changes), nn.Linear(1, 1))


def test_an_encoder_of_one_layer_has_none_to_tell_apart() -> None:
    network = nn.Module()
    network.encoder = nn.Linear(1, 1)
    with refused(OptionError, "optimizer.layer_decay", "fewer than two"):
        check_encoder(options(layer_decay=0.9), network)


def test_without_them_the_groups_are_as_before() -> None:
    network = Network()
    [group] = optimizer_of(options(lr=1e-3, weight_decay=0.1))(network).param_groups
    assert "lr_scale" not in group
    assert len(group["params"]) == len(list(network.parameters()))


@pytest.mark.parametrize("given", [{"unfreeze_at": 2}, {"unfreeze_at": 2, "freeze": ["first_conv"]}])
def test_what_was_never_kept_is_not_let_go(given: dict[str, Any]) -> None:
    with refused(OptionError, "model.unfreeze_at", "model.freeze=[encoder]"):
        model_options({"name": "bts", **given})


def test_a_network_that_cannot_learn_is_refused() -> None:
    class Fixed(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.register_buffer("scale", torch.ones(1))

    with refused(OptionError, "model", "Fixed has no parameters"):
        check_learns(Fixed())
    kept = nn.Linear(1, 1).requires_grad_(False)
    with refused(OptionError, "model", "Linear keeps "):
        check_learns(kept)
