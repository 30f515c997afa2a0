"""Convolution blocks of BTS: up-sampling, fusing with a skip connection, and their initialisation."""

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn.functional import conv2d

from col3d.layers.elu import ELU, elu_
from col3d.layers.up_conv import up_conv2d


def batch_norm(channels: int) -> nn.BatchNorm2d:
    """Batch norm with the momentum (0.01) and epsilon (1.1e-5) of BTS."""
    return nn.BatchNorm2d(channels, eps=1.1e-5, momentum=0.01)


def conv_elu(in_channels: int, out_channels: int, kernel: int = 3) -> nn.Sequential:
    """A same-size convolution without bias, then ELU."""
    conv = nn.Conv2d(in_channels, out_channels, kernel, padding=kernel // 2, bias=False)
    return nn.Sequential(conv, ELU())


class UpConv(nn.Module):
    """Nearest up-sampling by 2, then a 3x3 convolution without bias and ELU, by `up_conv2d`."""

    def __init__(self, in_channels: int, out_channels: int) -> None:
        super().__init__()
        self.conv = nn.Conv2d(in_channels, out_channels, 3, padding=1, bias=False)

    def forward(self, x: Float[Tensor, "b _ h w"]) -> Float[Tensor, "b _ 2*h 2*w"]:
        """Twice the height and width."""
        return elu_(up_conv2d(x, self.conv.weight))


class FuseELU(nn.Sequential):
    """A 3x3 convolution without bias over several maps, as if concatenated, then ELU.

    The maps are not concatenated: the convolution of a concatenation is the sum of convolutions of its parts,
    each with its share of the weights. So no copy of the maps is stored for the gradient.
    """

    def __init__(self, in_channels: int, out_channels: int) -> None:
        super().__init__(nn.Conv2d(in_channels, out_channels, 3, padding=1, bias=False))

    def forward(self, *maps: Float[Tensor, "b _ h w"]) -> Float[Tensor, "b _ h w"]:
        """Maps of the same size, possibly one without channels -> the fused map."""
        weights = self.get_parameter("0.weight").split([x.shape[1] for x in maps], dim=1)
        parts = [(x, share) for x, share in zip(maps, weights, strict=True) if x.shape[1]]
        first, *others = (
            conv2d(x.contiguous(memory_format=torch.channels_last), share, padding=1) for x, share in parts
        )
        for other in others:
            first += other
        return elu_(first)


class UpFuse(nn.Module):
    """One step up the decoder: up-convolution, batch norm, and a 3x3 ELU over that and the skips.

    Args:
        in_channels: channels of the coarse map.
        out_channels: channels of the result.
        skip_channels: channels of all skips together.
    """

    def __init__(self, in_channels: int, out_channels: int, skip_channels: int) -> None:
        super().__init__()
        self.up = UpConv(in_channels, out_channels)
        self.norm = batch_norm(out_channels)
        self.fuse = FuseELU(out_channels + skip_channels, out_channels)

    def rise(self, x: Float[Tensor, "b _ h w"]) -> Float[Tensor, "b _ 2*h 2*w"]:
        """The up-sampled map, before it is fused with the skips."""
        risen: Tensor = self.norm(self.up(x))
        return risen

    def forward(
        self, x: Float[Tensor, "b _ h w"], *skips: Float[Tensor, "b _ 2*h 2*w"]
    ) -> Float[Tensor, "b _ 2*h 2*w"]:
        """The coarse map and skips of twice its size -> a map of the skips' size."""
        fused: Tensor = self.fuse(self.rise(x), *skips)
        return fused


def shrink(x: Float[Tensor, "b _ h w"], factor: int) -> Float[Tensor, "b _ h2 w2"]:
    """Nearest down-sampling: the top-left value of every `factor` x `factor` patch."""
    return x[..., ::factor, ::factor]


def init_xavier(module: nn.Module) -> None:
    """Xavier-uniform weights and zero biases in every convolution below `module`."""
    for conv in module.modules():
        if isinstance(conv, nn.Conv2d):
            nn.init.xavier_uniform_(conv.weight)
            if conv.bias is not None:
                nn.init.zeros_(conv.bias)
