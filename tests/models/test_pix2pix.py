"""pix2pix: its function against a twin written as the paper nests it, its sizes, and its discriminator."""

from functools import cache
from itertools import pairwise

import pytest
import torch
from refusals import refused
from small import bfloat16_is_close, depth_is_in_range, every_parameter_has_learned, normals_build_upon
from torch import Tensor, nn
from torch.nn import functional as F

from col3d.errors import OptionError
from col3d.layers.patch_gan import PatchGAN, init_normal
from col3d.models.pix2pix import Pix2Pix, downs_for


@cache
def network(downs: int = 6) -> Pix2Pix:
    torch.manual_seed(0)
    return Pix2Pix(width=64, max_depth=80.0, size_hw=(2**downs, 2**downs))


def size_of(module: nn.Module) -> int:
    return sum(p.numel() for p in module.parameters())


def randomise(module: nn.Module) -> None:
    """So that every layer weighs in; the weights it starts from leave the inner ones little."""
    for layer in module.modules():
        if isinstance(layer, nn.Conv2d | nn.ConvTranspose2d):
            nn.init.kaiming_normal_(layer.weight)
        if isinstance(layer, nn.BatchNorm2d):
            nn.init.normal_(layer.running_mean, 0, 0.1)
            nn.init.uniform_(layer.running_var, 0.5, 2)
            nn.init.normal_(layer.bias, 0, 0.1)


class Twin:
    """Each level around the next, as the authors nest it: a skip beside up(inner(down(skip)))."""

    def __init__(self, network: Pix2Pix) -> None:
        self.state = {name: value.double() for name, value in network.state_dict().items()}
        self.downs = network.downs

    def norm(self, x: Tensor, name: str) -> Tensor:
        mean, var, weight, bias = (
            self.state[f"{name}.{leaf}"].view(1, -1, 1, 1)
            for leaf in ("running_mean", "running_var", "weight", "bias")
        )
        return (x - mean) / (var + 1e-5).sqrt() * weight + bias

    def level(self, x: Tensor, i: int) -> Tensor:
        down = F.conv2d(F.leaky_relu(x, 0.2), self.state[f"encoder.{i}.0.weight"], stride=2, padding=1)
        innermost = i == self.downs - 1
        inner = down if innermost else self.level(self.norm(down, f"encoder.{i}.1"), i + 1)
        block = f"decoder.{self.downs - 1 - i}"
        up = F.conv_transpose2d(F.relu(inner), self.state[f"{block}.0.weight"], stride=2, padding=1)
        return torch.cat([x, self.norm(up, f"{block}.1")], dim=1)

    def __call__(self, image: Tensor) -> Tensor:
        """Image in [-1, 1] -> depth in [-1, 1]."""
        x = F.conv2d(image, self.state["encoder.0.0.weight"], stride=2, padding=1)
        head, bias = self.state["head.weight"], self.state["head.bias"]
        return F.conv_transpose2d(F.relu(self.level(x, 1)), head, bias, stride=2, padding=1).tanh()


@pytest.mark.parametrize("downs", [5, 6, 8])
def test_is_the_published_function_of_the_image(downs: int) -> None:
    torch.manual_seed(0)
    side = 2**downs
    network = Pix2Pix(width=64, max_depth=80.0, size_hw=(side, side)).eval()
    randomise(network)
    image = torch.rand(2, 3, side, side)
    expected = 80 * (Twin(network)(2 * image.double() - 1) + 1) / 2
    with torch.no_grad():
        torch.testing.assert_close(network(image)["depth"].double(), expected, atol=1e-3, rtol=0)
        nn.init.zeros_(network.decoder[0][1].weight)
        assert (network(image)["depth"] - expected).abs().max() > 0.01  # the innermost map counts
    assert 5 < expected.std() < 30


def test_published_size() -> None:
    """64-128-256-512x5 down and up; a batch norm has two numbers a channel."""
    channels = [64, 128, 256, 512, 512, 512, 512, 512]
    steps = list(pairwise(channels))
    down = 16 * 3 * 64 + sum(16 * a * b for a, b in steps) + 2 * sum(channels[1:-1])
    innermost = 16 * 512 * 512 + 2 * 512
    up = innermost + sum(16 * 2 * b * a + 2 * a for a, b in steps[:-1]) + 16 * 128 * 1 + 1
    with torch.device("meta"):
        generator = Pix2Pix()
    assert generator.downs == 8
    assert size_of(generator) == down + up == 54_409_857
    two_more_outputs = 2 * (16 * 128 + 1)
    assert round((down + up + two_more_outputs) / 1e6, 3) == 54.414  # as the authors' program says of RGB


def test_dropout_is_in_three_inner_blocks() -> None:
    with torch.device("meta"):
        generator = Pix2Pix()
    rates = [layer.p for layer in generator.decoder.modules() if isinstance(layer, nn.Dropout)]
    assert rates == [0, 0.5, 0.5, 0.5, 0, 0, 0]
    fewer = [layer.p for layer in network(6).decoder.modules() if isinstance(layer, nn.Dropout)]
    assert fewer == [0, 0.5, 0, 0, 0]


@pytest.mark.parametrize(
    ("size", "downs"),
    [
        ((256, 256), 8),
        ((320, 320), 6),
        ((512, 512), 8),
        ((128, 160), 5),
        ((160, 128), 5),
        ((64, 64), 6),
        ((128, 256), 7),
        ((270, 338), 5),
        ((33, 64), 5),
    ],
)
def test_downs_follow_the_size(size: tuple[int, int], downs: int) -> None:
    with torch.device("meta"):
        generator = Pix2Pix(width=64, size_hw=size)
    assert (downs_for(size), generator.downs, generator.multiple) == (downs, downs, 2**downs)


def test_starts_from_normal_weights() -> None:
    torch.manual_seed(0)
    generator = Pix2Pix()
    for name, parameter in generator.named_parameters():
        middle = 1.0 if ".1.weight" in name else 0.0
        if name.endswith("bias"):
            assert not parameter.any()
        else:
            assert abs(parameter.mean().item() - middle) < 5e-3
            assert parameter.std().item() == pytest.approx(0.02, rel=0.25)


@pytest.mark.parametrize("size_hw", [(64, 64), (64, 128), (70, 100), (20, 40)])
def test_depth_is_in_range_whatever_the_size(size_hw: tuple[int, int]) -> None:
    depth_is_in_range(network(), size_hw, max_depth=80)


def test_small_depths_keep_their_digits() -> None:
    network = Pix2Pix(width=64, size_hw=(32, 32)).eval()
    nn.init.zeros_(network.head.weight)
    nn.init.constant_(network.head.bias, -12.0)  # tanh in float32 is -1 there
    with torch.no_grad():
        depth = network(torch.rand(1, 3, 32, 32))["depth"].double()
    exact = 100 * (torch.tensor(-12.0, dtype=torch.float64).tanh() + 1) / 2
    torch.testing.assert_close(depth, exact.expand_as(depth), rtol=1e-4, atol=0)


def test_what_is_offered_to_others() -> None:
    x = torch.randn(1, 3, 64, 128)
    with torch.no_grad():
        _, features = network().eval().estimate(x)
    assert [tuple(f.shape) for f in features] == [(1, 8, 32, 64), (1, 16, 16, 32), (1, 64, 8, 16)]
    assert network().feature_channels == (8, 16, 64)
    assert features.at8.min() == 0
    assert features.at2.min() < 0


def test_a_decoder_of_normals_builds_upon_the_u_net() -> None:
    normals_build_upon(Pix2Pix(width=64, size_hw=(64, 64)))


@pytest.mark.parametrize("batch", [1, 2])
def test_every_parameter_learns_even_from_one_image(batch: int) -> None:
    network = Pix2Pix(width=64, size_hw=(64, 64)).train()
    image = torch.rand(batch, 3, 64, 64, requires_grad=True)
    torch.manual_seed(0)
    network(image)["depth"].square().sum().backward()
    every_parameter_has_learned(network)
    assert image.grad is not None
    assert image.grad.any()


def test_bfloat16_stays_finite_and_close() -> None:
    bfloat16_is_close(network(), torch.rand(2, 3, 64, 64), mm=1)


@pytest.mark.parametrize(
    ("options", "about", "named"),
    [
        ({"encoder": "resnet18"}, "model.encoder", ("pix2pix", "none", "'resnet18'")),
        ({"pretrained": "imagenet"}, "model.pretrained", ("pix2pix", "none", "'imagenet'")),
        ({"width": 60}, "model.width", (8, 60)),
        ({"width": 0}, "model.width", (8, 0)),
    ],
)
def test_options_it_does_not_have(options: dict, about: str, named: tuple[object, ...]) -> None:
    with refused(OptionError, about, *named):
        Pix2Pix(**options)


def test_discriminator_has_the_published_size() -> None:
    inner = [(64, 128), (128, 256), (256, 512)]
    expected = 16 * 4 * 64 + 64 + sum(16 * a * b + 2 * b for a, b in inner) + 16 * 512 + 1
    assert size_of(PatchGAN()) == expected
    assert round(size_of(PatchGAN()) / 1e6, 2) == 2.77
    assert size_of(PatchGAN(in_channels=6)) == expected + 16 * 2 * 64  # 2.769 M, as the authors' program says
    assert round(size_of(PatchGAN(in_channels=6)) / 1e6, 3) == 2.769


def test_discriminator_is_the_published_function() -> None:
    torch.manual_seed(0)
    patch_gan = PatchGAN(width=64).eval()
    randomise(patch_gan)
    pair = torch.randn(2, 4, 80, 96)
    state = {name.removeprefix("layers."): value for name, value in patch_gan.state_dict().items()}
    x = F.conv2d(pair, state["0.0.weight"], state["0.0.bias"], stride=2, padding=1)
    for i, stride in ((1, 2), (2, 2), (3, 1)):
        x = F.conv2d(F.leaky_relu(x, 0.2), state[f"{i}.0.weight"], stride=stride, padding=1)
        leaves = ("running_mean", "running_var", "weight", "bias")
        x = F.batch_norm(x, *(state[f"{i}.1.{leaf}"] for leaf in leaves))
    expected = F.conv2d(F.leaky_relu(x, 0.2), state["4.weight"], state["4.bias"], padding=1)
    with torch.no_grad():
        torch.testing.assert_close(patch_gan(pair), expected)
    assert expected.std() > 0.1


def test_discriminator_looks_at_70_pixels() -> None:
    torch.manual_seed(0)
    patch_gan = PatchGAN(width=64).eval()
    pair = torch.randn(1, 4, 256, 256, requires_grad=True)
    logits = patch_gan(pair)
    assert logits.shape == (1, 1, 30, 30)
    spans = []
    for place in (15, 16):
        (gradient,) = torch.autograd.grad(logits[0, 0, place, place], pair, retain_graph=True)
        seen = gradient[0].abs().sum(dim=0)
        rows, columns = (seen.any(dim=d).nonzero().flatten() for d in (1, 0))
        assert (len(rows), len(columns)) == (70, 70)
        assert int(rows[-1] - rows[0]) == int(columns[-1] - columns[0]) == 69
        spans.append(int(rows[0]))
    assert spans[1] - spans[0] == 8


def test_discriminator_learns_and_sees_every_channel() -> None:
    patch_gan = PatchGAN(width=64)
    pair = torch.randn(1, 4, 70, 70, requires_grad=True)
    patch_gan(pair).square().sum().backward()
    assert pair.grad is not None
    assert pair.grad.flatten(2).any(dim=2).all()
    assert all(p.grad is not None and p.grad.any() for p in patch_gan.parameters())


def test_discriminator_width() -> None:
    with refused(OptionError, "model.width", 8, 4):
        PatchGAN(width=4)


def test_initialisation_leaves_other_layers_alone() -> None:
    linear = nn.Linear(3, 3)
    before = linear.weight.clone()
    init_normal(nn.Sequential(linear, nn.Conv2d(3, 3, 1, bias=False)))
    assert torch.equal(linear.weight, before)
