"""What does not learn, what it does meanwhile, and that it is as it was after a step."""

from collections.abc import Callable

import pytest
import torch
from refusals import refused
from torch import Tensor, nn

from col3d.errors import OptionError
from col3d.layers.encoder import Encoder
from col3d.layers.freeze import POLICIES, freeze
from col3d.training.parameter_groups import parameter_groups

IMAGE = torch.randn(2, 3, 64, 64, generator=torch.Generator().manual_seed(0))


class Network(nn.Module):
    """A depth at 1/32, and a batch norm that no policy is about."""

    def __init__(self) -> None:
        super().__init__()
        torch.manual_seed(0)
        self.encoder = Encoder("resnet18")
        self.decoder = nn.Sequential(nn.BatchNorm2d(512), nn.Conv2d(512, 1, 1))
        with torch.no_grad():
            for layer in self.modules():
                if isinstance(layer, nn.BatchNorm2d):  # as after a training
                    for name in ("weight", "bias", "running_mean", "running_var"):
                        values = getattr(layer, name)
                        values.add_(0.2 * torch.rand_like(values))

    def forward(self, image: Tensor) -> Tensor:
        depth: Tensor = self.decoder(self.encoder(image)[-1])
        return depth


def frozen(*policies: str) -> Network:
    network = Network()
    freeze(network, policies)
    return network


def encoder_state(network: Network, kind: str) -> dict[str, Tensor]:
    return {name: v.clone() for name, v in network.encoder.state_dict().items() if kind in name}


def in_batch_norm(name: str) -> bool:
    return name.startswith("encoder") and (".bn" in name or ".downsample.1." in name)


every_policy = pytest.mark.parametrize("policy", POLICIES)


@pytest.mark.parametrize(
    ("policies", "kept"),
    [
        (("first_conv",), lambda name: name == "encoder.net.conv1.weight"),
        (("batch_norm",), in_batch_norm),
        (("batch_norm_statistics",), in_batch_norm),
        (("encoder",), lambda name: name.startswith("encoder.")),
        (("first_conv", "batch_norm"), lambda n: n == "encoder.net.conv1.weight" or in_batch_norm(n)),
        (("batch_norm_statistics", "batch_norm"), in_batch_norm),
        ((), lambda name: False),
    ],
)
def test_a_policy_keeps_what_it_says_and_nothing_else(
    policies: tuple[str, ...], kept: Callable[[str], bool]
) -> None:
    learning = {name for name, p in frozen(*policies).named_parameters() if p.requires_grad}
    names = {name for name, _ in Network().named_parameters()}
    assert names - learning == {name for name in names if kept(name)}


def test_batch_norms_that_do_not_learn_still_follow_their_batches() -> None:
    network = frozen("batch_norm")
    before = encoder_state(network, "running_")
    network(IMAGE)
    after = encoder_state(network, "running_")
    assert len(before) == 2 * 20
    assert all(not torch.equal(before[name], after[name]) for name in before)


def test_kept_statistics_are_those_of_no_batch() -> None:
    network = frozen("batch_norm_statistics")
    before = encoder_state(network, "running_")
    training = network.train().encoder(IMAGE)
    after = encoder_state(network, "running_")
    assert len(before) == 2 * 20
    assert all(torch.equal(before[name], after[name]) for name in before)
    for found, expected in zip(training, network.eval().encoder(IMAGE), strict=True):
        assert torch.equal(found, expected)


@every_policy
def test_freezing_changes_no_evaluation(policy: str) -> None:
    expected = Network().eval()(IMAGE)
    torch.testing.assert_close(frozen(policy).eval()(IMAGE), expected, atol=1e-5, rtol=1e-5)


@every_policy
def test_a_step_of_training_leaves_what_is_frozen_bit_for_bit_and_moves_the_rest(policy: str) -> None:
    network = frozen(policy)
    weights = ("weight", "bias")
    before = {name: v.clone() for name, v in network.state_dict().items() if name.endswith(weights)}
    learning = {name for name, p in network.named_parameters() if p.requires_grad}
    optimizer = torch.optim.AdamW(parameter_groups(network, 0.5, 0.1), lr=1e-2)
    assert sum(len(group["params"]) for group in optimizer.param_groups) == len(learning)
    network(IMAGE).square().sum().backward()
    optimizer.step()
    after = network.state_dict()
    assert {name for name in before if not torch.equal(before[name], after[name])} == learning
    assert learning < before.keys()


def test_an_unknown_policy_is_refused() -> None:
    with refused(OptionError, "model.freeze", "'batch_norms'", "'batch_norm'"):
        frozen("batch_norms")


@pytest.mark.parametrize(
    ("policy", "what"),
    [("batch_norm", "batch norm"), ("batch_norm_statistics", "batch norm"), ("first_conv", "convolution")],
)
def test_an_encoder_without_what_is_to_be_kept_is_refused(policy: str, what: str) -> None:
    network = nn.ModuleDict({"encoder": nn.Linear(2, 2), "decoder": nn.Conv2d(2, 2, 1)})
    with refused(OptionError, "model.freeze", policy, f"no {what}"):
        freeze(network, [policy])
