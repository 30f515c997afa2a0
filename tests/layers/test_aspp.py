"""How far each branch looks, what it sees, and the sizes at the published width."""

import pytest
import torch
from refusals import refused
from torch import nn

from col3d.errors import OptionError
from col3d.layers.aspp import RATES, AtrousBranch, DenseASPP, DenseTrunk


@pytest.mark.parametrize("rate", RATES)
def test_branch_reaches_exactly_its_rate(rate: int) -> None:
    branch, centre, side = AtrousBranch(1, 4, rate, norm_in=False).eval(), 30, 61
    for weight in branch.parameters():
        nn.init.ones_(weight)
    impulse = torch.zeros(1, 1, side, side)
    impulse[..., centre, centre] = 1
    rows = torch.nonzero((branch(impulse) > branch(0 * impulse) + 1e-4).any(dim=-1)[0, 0])
    assert rows.flatten().tolist() == [centre - rate, centre, centre + rate]


def test_dense_aspp_equals_a_written_out_twin() -> None:
    aspp = DenseASPP(concat_channels=24, width=64).eval()
    fused, concat = torch.randn(1, 32, 4, 4), torch.randn(1, 24, 4, 4)
    b3, b6, b12, b18, b24 = aspp.branches
    at3 = b3(fused)
    at6 = b6(torch.cat([concat, at3], 1))
    at12 = b12(torch.cat([concat, at3, at6], 1))
    at18 = b18(torch.cat([concat, at3, at6, at12], 1))
    at24 = b24(torch.cat([concat, at3, at6, at12, at18], 1))
    expected = aspp.fuse(torch.cat([fused, at3, at6, at12, at18, at24], 1))
    assert torch.equal(aspp(fused, concat), expected)


def test_sizes_at_the_published_width() -> None:
    trunk = DenseTrunk([64, 256, 512, 1024, 2048], width=512)
    into = [branch.reduce.in_channels for branch in trunk.aspp.branches]
    assert into == [256, 896, 1024, 1152, 1280]
    assert (trunk.aspp.fuse[0].in_channels, trunk.aspp.fuse[0].out_channels) == (896, 128)


@pytest.mark.parametrize("width", [0, -64, 100])
def test_width_must_fit(width: int) -> None:
    with refused(OptionError, "model.width", 64, width):
        DenseTrunk([1, 1, 1, 1, 1], width)
