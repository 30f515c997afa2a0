"""BTS-CBAM: where attention acts, and the two depths at full size."""

import torch
from refusals import refused
from torch import nn

from col3d.errors import OptionError
from col3d.layers.cbam import CBAM
from col3d.models.bts import BTS
from col3d.models.bts_cbam import BTSCBAM, PublishedFinestDepth


def test_attention_sits_in_five_places() -> None:
    decoder = BTSCBAM("resnet18", width=64).depth_decoder
    places = [name for name, block in decoder.named_children() if isinstance(block, CBAM)]
    assert sorted(places) == ["attend2", "attend4", "attend8", "attend_skip2", "attend_skip4"]


def test_without_attention_it_is_bts() -> None:
    network, plain, image = BTSCBAM("resnet18", width=64), BTS("resnet18", width=64), torch.rand(1, 3, 64, 64)
    for name, block in list(network.depth_decoder.named_children()):
        if isinstance(block, CBAM):
            network.depth_decoder.set_submodule(name, nn.Identity())
    plain.load_state_dict(network.state_dict())
    assert torch.equal(network.eval()(image)["depth"], plain.eval()(image)["depth"])


def test_published_depth_divides_by_the_sum_of_the_normal() -> None:
    block, x = PublishedFinestDepth(4), torch.randn(1, 4, 3, 5)
    theta, phi, distance = (
        block.reduction(x).sigmoid()[0] * torch.tensor([torch.pi / 3, 2 * torch.pi, 1.0])[:, None, None]
    )
    expected = distance / (theta.sin() * phi.cos() + theta.sin() * phi.sin() + theta.cos())
    torch.testing.assert_close(block(x)[0, 0], expected, atol=1e-5, rtol=1e-5)


def test_unknown_heads() -> None:
    with refused(OptionError, "model.heads", "'publish'", "'published'"):
        BTSCBAM("resnet18", width=64, heads="publish")
