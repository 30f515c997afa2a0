"""Trunk shared by all decoders: from the encoder's deepest maps to one map at 1/8 of the image."""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn

from col3d.errors import OptionError
from col3d.layers.conv import UpFuse, batch_norm, conv_elu

RATES = (3, 6, 12, 18, 24)


class AtrousBranch(nn.Module):
    """[Batch norm,] ReLU, 1x1 to F/2, batch norm, ReLU, 3x3 dilated by `rate` to F/4.

    Args:
        in_channels: channels that come in.
        width: F, which every size of the decoder scales from.
        rate: dilation of the 3x3 convolution.
        norm_in: whether the input is normalised; the first branch's comes normalised already.
    """

    def __init__(self, in_channels: int, width: int, rate: int, norm_in: bool = True) -> None:
        super().__init__()
        self.norm_in = batch_norm(in_channels) if norm_in else nn.Identity()
        self.reduce = nn.Conv2d(in_channels, width // 2, 1, bias=False)
        self.norm = nn.BatchNorm2d(width // 2, momentum=0.01)
        self.atrous = nn.Conv2d(width // 2, width // 4, 3, padding=rate, dilation=rate, bias=False)

    def forward(self, x: Float[Tensor, "b _ h w"]) -> Float[Tensor, "b _ h w"]:
        """A map -> F/4 channels that look `rate` pixels around."""
        x = self.reduce(nn.functional.relu(self.norm_in(x)))
        context: Tensor = self.atrous(nn.functional.relu(self.norm(x)))
        return context


class DenseASPP(nn.Module):
    """Atrous branches, each of which also sees the outputs of the earlier ones.

    The first branch takes the fused map (F/2); every later one takes the maps that it was fused from and the
    outputs of all earlier branches. The fused map and all outputs end in a 3x3 convolution to F/4.

    References:
        Yang et al., DenseASPP for Semantic Segmentation in Street Scenes, CVPR 2018.
    """

    def __init__(self, concat_channels: int, width: int) -> None:
        super().__init__()
        first = AtrousBranch(width // 2, width, RATES[0], norm_in=False)
        later = [
            AtrousBranch(concat_channels + (i + 1) * (width // 4), width, rate)
            for i, rate in enumerate(RATES[1:])
        ]
        self.branches = nn.ModuleList([first, *later])
        self.fuse = conv_elu(width // 2 + len(RATES) * (width // 4), width // 4)

    def forward(
        self, fused: Float[Tensor, "b _ h w"], concat: Float[Tensor, "b _ h w"]
    ) -> Float[Tensor, "b _ h w"]:
        """The fused map and the maps it was fused from -> F/4 channels with context of every rate."""
        outputs = [self.branches[0](fused)]
        for branch in list(self.branches)[1:]:
            outputs.append(branch(torch.cat([concat, *outputs], dim=1)))
        context: Tensor = self.fuse(torch.cat([fused, *outputs], dim=1))
        return context


class DenseTrunk(nn.Module):
    """Two steps up from /32 to /8, then dense ASPP: F/4 channels at 1/8 of the image.

    Args:
        channels: the encoder's channels at /2, /4, /8, /16 and /32.
        width: F; 512 is published.

    Raises:
        ValueError: the width is not a positive multiple of 64, so that some decoder would lack channels.
    """

    def __init__(self, channels: Sequence[int], width: int) -> None:
        super().__init__()
        if width <= 0 or width % 64:
            raise OptionError(f"model.width: must be a positive multiple of 64, got {width}")
        *_, at8, at16, at32 = channels
        self.up16 = UpFuse(at32, width, at16)
        self.up8 = UpFuse(width, width // 2, at8)
        self.norm = batch_norm(width // 2)
        self.aspp = DenseASPP(width // 2 + at8, width)

    def forward(self, features: Sequence[Float[Tensor, "b _ _ _"]]) -> Float[Tensor, "b _ h8 w8"]:
        """The encoder's five maps -> the trunk's."""
        *_, at8, at16, at32 = features
        risen = self.up8.rise(self.up16(nn.functional.relu(at32), at16))
        fused = self.norm(self.up8.fuse(risen, at8))
        context: Tensor = self.aspp(fused, torch.cat([risen, at8], dim=1))
        return context
