"""Up-sampling, fusing and shrinking."""

import torch
from torch import nn

from col3d.layers.conv import UpConv, UpFuse, init_xavier, shrink


def test_up_conv_doubles_and_repeats() -> None:
    block = UpConv(1, 1)
    nn.init.dirac_(block.conv.weight)
    x = torch.rand(1, 1, 2, 3)
    assert torch.equal(block(x), x.repeat_interleave(2, 2).repeat_interleave(2, 3))


def test_shrink_undoes_repetition() -> None:
    x = torch.rand(2, 3, 4, 5)
    assert torch.equal(shrink(x.repeat_interleave(4, 2).repeat_interleave(4, 3), 4), x)


def test_shrink_is_nearest_interpolation() -> None:
    x = torch.rand(2, 3, 8, 16)
    assert torch.equal(shrink(x, 4), nn.functional.interpolate(x, scale_factor=0.25, mode="nearest"))


def test_up_fuse_takes_any_number_of_skips() -> None:
    block = UpFuse(8, 4, skip_channels=3)
    skips = torch.rand(2, 1, 6, 10), torch.rand(2, 2, 6, 10)
    assert block(torch.rand(2, 8, 3, 5), *skips).shape == (2, 4, 6, 10)
    assert (block.norm.momentum, block.norm.eps) == (0.01, 1.1e-5)


def test_init_stays_inside_the_bound_of_xavier() -> None:
    conv = nn.Conv2d(16, 8, 3)
    init_xavier(conv)
    bound = (6 / (16 * 9 + 8 * 9)) ** 0.5
    assert 0.9 * bound < conv.weight.abs().max() <= bound
    assert not conv.bias.any()
