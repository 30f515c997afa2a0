"""Who learns with which weight decay, and how fast at each step."""

from typing import Any

from torch import nn

from col3d.training.parameter_groups import parameter_groups


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
