"""Convolution blocks of BTS: up-sampling, fusing with a skip connection, and their initialisation."""

import torch
from jaxtyping import Float
from torch import Tensor, nn


def batch_norm(channels: int) -> nn.BatchNorm2d:
    """Batch norm with the momentum (0.01) and epsilon (1.1e-5) of BTS."""
    return nn.BatchNorm2d(channels, eps=1.1e-5, momentum=0.01)


def conv_elu(in_channels: int, out_channels: int, kernel: int = 3) -> nn.Sequential:
    """A same-size convolution without bias, then ELU."""
    conv = nn.Conv2d(in_channels, out_channels, kernel, padding=kernel // 2, bias=False)
    return nn.Sequential(conv, nn.ELU())


class UpConv(nn.Module):
    """Nearest up-sampling by 2, then a 3x3 convolution without bias and ELU."""

    def __init__(self, in_channels: int, out_channels: int) -> None:
        super().__init__()
        self.conv = nn.Conv2d(in_channels, out_channels, 3, padding=1, bias=False)

    def forward(self, x: Float[Tensor, "b _ h w"]) -> Float[Tensor, "b _ 2*h 2*w"]:
        """Twice the height and width."""
        return nn.functional.elu(self.conv(nn.functional.interpolate(x, scale_factor=2, mode="nearest")))


class UpFuse(nn.Module):
    """One step up the decoder: up-convolution, batch norm, concatenation with skips, 3x3 ELU.

    Args:
        in_channels: channels of the coarse map.
        out_channels: channels of the result.
        skip_channels: channels of all skips together.
    """

    def __init__(self, in_channels: int, out_channels: int, skip_channels: int) -> None:
        super().__init__()
        self.up = UpConv(in_channels, out_channels)
        self.norm = batch_norm(out_channels)
        self.fuse = conv_elu(out_channels + skip_channels, out_channels)

    def concat(
        self, x: Float[Tensor, "b _ h w"], *skips: Float[Tensor, "b _ 2*h 2*w"]
    ) -> Float[Tensor, "b _ 2*h 2*w"]:
        """The up-sampled map beside the skips, before they are fused."""
        return torch.cat([self.norm(self.up(x)), *skips], dim=1)

    def forward(
        self, x: Float[Tensor, "b _ h w"], *skips: Float[Tensor, "b _ 2*h 2*w"]
    ) -> Float[Tensor, "b _ 2*h 2*w"]:
        """The coarse map and skips of twice its size -> a map of the skips' size."""
        fused: Tensor = self.fuse(self.concat(x, *skips))
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
