"""The depth decoder of BTS: from the trunk at 1/8 to full size, guided by local planes."""

from collections.abc import Callable, Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn

from col3d.geometry.precision import at_least_float32
from col3d.layers.conv import FuseELU, UpConv, UpFuse, shrink
from col3d.layers.planar import PlanarGuidance, Reduction


class FinestDepth(nn.Module):
    """Features at full size -> depth as a fraction of the maximum depth; at one pixel no plane is needed."""

    def __init__(self, in_channels: int) -> None:
        super().__init__()
        self.reduction = Reduction(in_channels, in_channels // 2, 1)

    def forward(self, x: Float[Tensor, "b _ h w"]) -> Float[Tensor, "b 1 h w"]:
        """A map -> fraction of the maximum depth in (0, 1)."""
        return torch.sigmoid(at_least_float32(self.reduction(x)))


class DepthDecoder(nn.Module):
    """Planes at 1/8, 1/4 and 1/2 guide the decoder; all of them enter the last convolution.

    Args:
        channels: the encoder's channels at /2, /4, /8, /16 and /32; the first two are skip connections.
        width: F; 512 is published.
        max_depth: upper bound of the depth in mm.
        attention: makes the attention block for a number of channels; none by default.
        finest: makes the block that estimates depth at full size from a number of channels.
    """

    def __init__(
        self,
        channels: Sequence[int],
        width: int,
        max_depth: float,
        attention: Callable[[int], nn.Module] = nn.Identity,
        finest: Callable[[int], nn.Module] = FinestDepth,
    ) -> None:
        super().__init__()
        skip2, skip4 = channels[:2]
        f4, f8, f16 = width // 4, width // 8, width // 16
        self.max_depth = max_depth
        self.attend8, self.plane8 = attention(f4), PlanarGuidance(f4, f4, patch=8)
        self.attend_skip4, self.up4 = attention(skip4), UpFuse(f4, f4, skip4 + 1)
        self.attend4, self.plane4 = attention(f4), PlanarGuidance(f4, f8, patch=4)
        self.attend_skip2, self.up2 = attention(skip2), UpFuse(f4, f8, skip2 + 1)
        self.attend2, self.plane2 = attention(f8), PlanarGuidance(f8, f16, patch=2)
        self.up1, self.finest = UpConv(f8, f16), finest(f16)
        self.fuse = FuseELU(f16 + 4, f16)
        self.head = nn.Conv2d(f16, 1, 3, padding=1, bias=False)

    def forward(
        self,
        x: Float[Tensor, "b _ h8 w8"],
        skip2: Float[Tensor, "b _ h2 w2"],
        skip4: Float[Tensor, "b _ h4 w4"],
    ) -> Float[Tensor, "b 1 h w"]:
        """The trunk's map and the encoder's at 1/2 and 1/4 -> depth in mm, in (0, max_depth)."""
        x = self.attend8(x)
        at8 = self.plane8(x)
        x = self.attend4(self.up4(x, self.attend_skip4(skip4), shrink(at8, 4)))
        at4 = self.plane4(x)
        x = self.attend2(self.up2(x, self.attend_skip2(skip2), shrink(at4, 2)))
        at2 = self.plane2(x)
        x = self.up1(x)
        x = self.fuse(x, torch.cat([self.finest(x), at2, at4, at8], dim=1))
        with torch.autocast(x.device.type, enabled=False):
            return self.max_depth * torch.sigmoid(at_least_float32(self.head(x.to(self.head.weight.dtype))))
