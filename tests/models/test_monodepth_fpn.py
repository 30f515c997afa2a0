"""MonoDepth-FPN: the public program's names, its sizes, its range, and what it offers to other decoders."""

from functools import cache

import pytest
import torch
from parity import needs_parity, published_state
from refusals import refused
from small import bfloat16_is_close, depth_is_in_range, every_parameter_has_learned, normals_build_upon
from torch import Tensor, nn

from col3d.errors import OptionError
from col3d.models.monodepth_fpn import FeaturePyramid, MonoDepthFPN, enlarge_smoothly
from col3d.models.published.monodepth_fpn import RULES, options
from col3d.models.published.source import our_name


@cache
def network() -> MonoDepthFPN:
    torch.manual_seed(0)
    return MonoDepthFPN("resnet18", width=64, max_depth=80.0)


def quarter_of(network: MonoDepthFPN, x: Tensor) -> Tensor:
    found: list[Tensor] = []
    hook = network.depth_decoder.register_forward_hook(lambda _, __, out: found.append(out))
    with torch.no_grad():
        network.eval().forward_normalised(x)
    hook.remove()
    return found[0]


def published_name(name: str) -> str:
    """The way back from this package's names, written independently of `RULES`."""
    number = {"at32": "1", "at16": "2", "at8": "3", "at4": "4"}
    laterals = {"at32": "toplayer", "at16": "latlayer1", "at8": "latlayer2", "at4": "latlayer3"}
    match name.split("."):
        case ["encoder", "net", "conv1" | "bn1" as first, leaf]:
            parts = ["layer0", "01"[first == "bn1"], leaf]
        case ["encoder", "net", stage, *rest]:
            parts = [stage, "0", *rest]
        case ["pyramid", "lateral", level, leaf]:
            parts = [laterals[level], leaf]
        case ["pyramid", "smooth", level, leaf]:
            parts = [f"smooth{int(number[level]) - 1}", leaf]
        case ["depth_decoder", "refine", level, "4", leaf]:
            parts = [f"up{number[level]}", "0", leaf]
        case ["depth_decoder", "refine", level, *rest]:
            parts = [f"agg{number[level]}", *rest]
        case [_, "fuse" | "head" as last, *_, leaf]:
            parts = [{"fuse": "predict1", "head": "predict2"}[last], "0", leaf]
    return ".".join(parts)


@pytest.mark.parametrize(
    ("encoder", "width"),
    [("resnet18", 64), ("resnet34", 32), ("resnet50", 512), ("resnet101", 128), ("resnet152", 64)],
)
def test_published_names_tell_the_options(encoder: str, width: int) -> None:
    with torch.device("meta"):
        state = MonoDepthFPN(encoder, width=width).state_dict()
    published = {published_name(name): value for name, value in state.items()}
    assert options(published) == {"encoder": encoder, "width": width}
    assert [our_name(name, RULES) for name in published] == list(state)


@needs_parity
def test_names_are_those_of_the_public_program() -> None:
    with torch.device("meta"):
        state = MonoDepthFPN("resnet101").state_dict()
    floating = {published_name(n): tuple(v.shape) for n, v in state.items() if v.is_floating_point()}
    assert floating == {name: tuple(value.shape) for name, value in published_state("monodepth_fpn").items()}


def test_refuses_what_is_no_such_program() -> None:
    with refused(ValueError, "state_dict", "resnet18, ", "0, 0, 0, 0 blocks"):
        options({"encoder.weight": torch.zeros(1)})
    blocks = {f"layer{s}.0.{i}.conv1.weight": torch.zeros(1) for s in (1, 2, 3, 4) for i in (0, 1)}
    with refused(ValueError, "state_dict", "smooth1"):
        options(blocks)


def test_published_size() -> None:
    with torch.device("meta"):
        network = MonoDepthFPN("resnet101")
    encoder = sum(p.numel() for p in network.encoder.parameters())
    decoder = sum(p.numel() for p in network.parameters()) - encoder
    lateral = (2048 + 1024 + 512 + 256 + 4) * 256
    conv = 9 * 256 * 256 + 256
    levels = 4 * (conv + 9 * 256 * 128 + 128)
    shuffles = sum((9 * 128 + 1) * 128 * factor**2 for factor in (2, 4, 8))
    last = 9 * 512 * 128 + 128 + 9 * 128 + 1
    assert encoder == 42_500_160  # ResNet-101 without its classifier
    assert decoder == lateral + 3 * conv + levels + shuffles + last


@pytest.mark.parametrize("size_hw", [(64, 96), (33, 70)])
def test_depth_is_in_range_at_any_size(size_hw: tuple[int, int]) -> None:
    depth_is_in_range(network(), size_hw, max_depth=80)


def test_full_size_is_the_enlarged_quarter() -> None:
    x = torch.randn(1, 3, 64, 96)
    quarter = quarter_of(network(), x)
    assert quarter.shape == (1, 1, 16, 24)
    with torch.no_grad():
        depth = network().eval().forward_normalised(x)["depth"]
    torch.testing.assert_close(depth, 80 * enlarge_smoothly(quarter, 4))


def test_enlarging_keeps_a_slope_at_pixel_centres() -> None:
    centres = torch.arange(6.0).view(1, 1, 1, 6).expand(1, 1, 4, 6)
    enlarged = enlarge_smoothly(centres, 4)[0, 0, 5]
    torch.testing.assert_close(enlarged[2:-2], (torch.arange(24.0)[2:-2] + 0.5) / 4 - 0.5)


def test_what_is_offered_to_other_decoders() -> None:
    x = torch.randn(1, 3, 64, 96)
    with torch.no_grad():
        _, features = network().eval().estimate(x)
        maps = network().encoder(x)
        levels = network().pyramid(maps[1:])
    assert [tuple(f.shape) for f in features] == [
        (1, channels, 64 // k, 96 // k)
        for channels, k in zip(network().feature_channels, (2, 4, 8), strict=True)
    ]
    assert torch.equal(features.at2, maps[0])
    assert torch.equal(features.at4, maps[1])
    assert torch.equal(features.at8, levels[2])


def test_a_decoder_of_normals_builds_upon_it() -> None:
    normals_build_upon(MonoDepthFPN("resnet18", width=64))


def test_pyramid_adds_what_comes_from_above() -> None:
    pyramid = FeaturePyramid([8, 8, 8, 8], 16)
    for conv in [*pyramid.lateral.values(), *pyramid.smooth.values()]:
        nn.init.dirac_(conv.weight)
        nn.init.zeros_(conv.bias)
    maps = [torch.full((1, 8, 32 // k, 32 // k), float(k)) for k in (4, 8, 16, 32)]
    levels = pyramid(maps)
    assert [level.shape[-1] for level in levels] == [1, 2, 4, 8]
    assert [level[0, 0].mean().item() for level in levels[:2]] == [32.0, 48.0]
    assert levels[3][0, 0, 4, 4].item() == 60.0


def test_every_parameter_learns() -> None:
    torch.manual_seed(1)
    network = MonoDepthFPN("resnet18", width=64)
    for name, weight in network.encoder.named_parameters():
        if "bn2.weight" in name:  # timm starts these at zero, which hides the convolutions before them
            nn.init.ones_(weight)
    network(torch.rand(2, 3, 64, 96))["depth"].square().sum().backward()
    every_parameter_has_learned(network)


def test_bfloat16_is_finite_and_close() -> None:
    bfloat16_is_close(network(), torch.rand(2, 3, 64, 64), mm=1)


@pytest.mark.parametrize("width", [0, -4, 66])
def test_width_that_does_not_divide(width: int) -> None:
    with refused(OptionError, "model.width", 4, width):
        MonoDepthFPN("resnet18", width=width)
