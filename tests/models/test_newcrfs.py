"""The authors' shapes; depth in its range, in every precision, from every parameter."""

import re

import pytest
import torch
from parity import needs_parity, published_shapes
from refusals import refused
from small import bfloat16_is_close, every_parameter_has_learned
from torch import Tensor, nn

from col3d.errors import OptionError
from col3d.models.newcrfs import NeWCRFs
from col3d.models.published.newcrfs import RULES, UNUSED, options
from col3d.models.published.source import our_name

TINY = "swin_tiny_patch4_window7_224"


def published(name: str) -> dict[str, Tensor]:
    """Empty tensors of the published names and shapes, but those on which nothing depends."""
    shapes = published_shapes(name)
    return {n: torch.empty(shape, device="meta") for n, shape in shapes.items() if not re.search(UNUSED, n)}


def group_norm(tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    """The names that the authors' own program gives, whose pooled maps have group norm."""
    statistics = r"psp_modules\..*(running_|num_batches)"
    return {
        re.sub(r"(psp_modules\..*)\.bn\.", r"\1.gn.", name): value
        for name, value in tensors.items()
        if not re.search(statistics, name)
    }


def load(network: nn.Module, tensors: dict[str, Tensor]) -> None:
    network.load_state_dict({our_name(name, RULES): value for name, value in tensors.items()}, assign=True)


@pytest.fixture(scope="module")
def network() -> NeWCRFs:
    torch.manual_seed(0)
    return NeWCRFs(TINY, width=64).eval()


@needs_parity
@pytest.mark.parametrize("norm", ["batch", "group"])
@pytest.mark.parametrize("name", ["tiny", "base"])
def test_published_tensors_are_all_of_the_network(name: str, norm: str) -> None:
    tensors = published("newcrfs" if name == "tiny" else "newcrfs_base")
    tensors = group_norm(tensors) if norm == "group" else tensors
    found = options(tensors)
    assert found == {"encoder": f"swin_{name}_patch4_window7_224", "width": 512, "pyramid_norm": norm}
    with torch.device("meta"):
        load(NeWCRFs(**found), tensors)


def sizes(channels: int, blocks: tuple[int, ...]) -> dict[str, Tensor]:
    """Just the tensors that tell sizes, of a network of width 128."""
    names = [
        f"backbone.layers.{stage}.blocks.{i}.norm1.bias" for stage, n in enumerate(blocks) for i in range(n)
    ]
    return dict.fromkeys(names, torch.empty(0)) | {
        "backbone.patch_embed.proj.weight": torch.empty(channels, 3, 4, 4),
        "decoder.bottleneck.conv.weight": torch.empty(128, 0),
    }


@pytest.mark.parametrize(("size", "channels"), [("small", 96), ("large", 192)])
def test_options_from_sizes(size: str, channels: int) -> None:
    found = options(sizes(channels, (2, 2, 18, 2)))
    assert found == {"encoder": f"swin_{size}_patch4_window7_224", "width": 128, "pyramid_norm": "group"}


def test_refuses_tensors_of_no_known_encoder() -> None:
    with refused(ValueError, "state_dict", "swin_large", "64 channels at 1/4", "2, 2, 6, 0 blocks"):
        options(sizes(64, (2, 2, 6)))
    with refused(ValueError, "state_dict", "patch_embed"):
        options({"crf3.norm_crf.weight": torch.empty(0)})


@pytest.mark.parametrize("pyramid_norm", ["group", "batch"])
def test_depth_and_features_of_any_size(pyramid_norm: str) -> None:
    network = NeWCRFs(TINY, max_depth=10.0, width=64, pyramid_norm=pyramid_norm).eval()
    with torch.no_grad():
        depth, features = network.estimate(torch.randn(2, 3, 64, 96))
        assert network(torch.rand(1, 3, 33, 50))["depth"].shape == (1, 1, 33, 50)
    assert depth.shape == (2, 1, 64, 96)
    assert 0 < depth.min() < depth.max() < 10
    assert tuple(f.shape[1] for f in features) == network.feature_channels == (0, 96, 32)
    assert [f.shape[2:] for f in features] == [(32, 48), (16, 24), (8, 12)]


def test_bfloat16_is_finite_and_close(network: NeWCRFs) -> None:
    bfloat16_is_close(network, torch.rand(1, 3, 64, 96), mm=2)


def test_every_parameter_learns(network: NeWCRFs) -> None:
    depth = network(torch.rand(2, 3, 64, 64))["depth"]
    (depth * torch.randn_like(depth)).sum().backward()
    every_parameter_has_learned(network)


@pytest.mark.parametrize(
    ("options", "about", "named"),
    [
        ({"width": 100}, "model.width", (64, 100)),
        ({"encoder": "resnet50"}, "model.encoder", ("newcrfs", "Swin", "'resnet50'")),
        ({"pyramid_norm": "layer"}, "model.pyramid_norm", ("'layer'", "group, batch")),
    ],
)
def test_refuses_options(options: dict[str, object], about: str, named: tuple[object, ...]) -> None:
    with refused(OptionError, about, *named):
        NeWCRFs(**{"encoder": TINY, **options})
