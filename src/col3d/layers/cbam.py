"""Convolutional block attention module (CBAM): channel attention, then spatial attention."""

import torch
from jaxtyping import Float
from torch import Tensor, nn


class ChannelAttention(nn.Module):
    """One weight in (0, 1) per channel: sigmoid(mlp(mean of the map) + mlp(maximum of the map)).

    Args:
        channels: channels of the map.
        ratio: reduction of channels in the hidden layer (at least one is kept).
    """

    def __init__(self, channels: int, ratio: int = 16) -> None:
        super().__init__()
        hidden = max(1, channels // ratio)
        self.mlp = nn.Sequential(
            nn.Conv2d(channels, hidden, 1, bias=False), nn.ReLU(), nn.Conv2d(hidden, channels, 1, bias=False)
        )

    def forward(self, x: Float[Tensor, "b c _ _"]) -> Float[Tensor, "b c 1 1"]:
        """A map -> the weights of its channels."""
        mean, maximum = x.mean(dim=(2, 3), keepdim=True), x.amax(dim=(2, 3), keepdim=True)
        return torch.sigmoid(self.mlp(mean) + self.mlp(maximum))


class SpatialAttention(nn.Module):
    """One weight in (0, 1) per pixel: sigmoid of a convolution of the channels' mean and maximum."""

    def __init__(self, kernel: int = 7) -> None:
        super().__init__()
        self.conv = nn.Conv2d(2, 1, kernel, padding=kernel // 2, bias=False)

    def forward(self, x: Float[Tensor, "b _ h w"]) -> Float[Tensor, "b 1 h w"]:
        """A map -> the weights of its pixels."""
        pooled = torch.cat([x.mean(dim=1, keepdim=True), x.amax(dim=1, keepdim=True)], dim=1)
        return torch.sigmoid(self.conv(pooled))


class CBAM(nn.Module):
    """Channel attention, then spatial attention: F' = M_c(F) * F, F'' = M_s(F') * F'.

    References:
        Woo et al., CBAM: Convolutional Block Attention Module, ECCV 2018, equation 1.
    """

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.channel = ChannelAttention(channels)
        self.spatial = SpatialAttention()

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b c h w"]:
        """A map -> the map times both attentions."""
        x = x * self.channel(x)
        return x * self.spatial(x)
