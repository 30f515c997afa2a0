"""pix2pix: image-to-image translation to depth, by a U-Net trained against a discriminator."""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn

from col3d.errors import OptionError
from col3d.geometry.precision import at_least_float32
from col3d.layers.network import DepthNetwork
from col3d.layers.normal_decoder import Features
from col3d.layers.patch_gan import halve, init_normal
from col3d.models.options import SMALLER, MaxDepth, Width
from col3d.registry import register_model

LEAST_DOWNS, MOST_DOWNS = 5, 8
PUBLISHED_SIZE = (256, 256)


def downs_for(size: tuple[int, int]) -> int:
    """Number of times an image of (height, width) is halved: as often as it divides evenly, 5 to 8.

    The published 8 times need sides that are multiples of 256. Below 5, where the published layers end, sides
    are padded instead, to a multiple of 32 as for every other network.

    >>> [downs_for(size) for size in ((256, 256), (320, 320), (128, 160), (64, 64), (270, 338))]
    [8, 6, 5, 6, 5]
    """
    possible = range(LEAST_DOWNS, MOST_DOWNS + 1)
    return max((n for n in possible if not any(side % 2**n for side in size)), default=LEAST_DOWNS)


def double(in_channels: int, out_channels: int, dropout: float = 0.0) -> nn.Sequential:
    """4x4 transposed convolution of stride 2, batch norm, [dropout,] ReLU: twice the height and width."""
    conv = nn.ConvTranspose2d(in_channels, out_channels, 4, stride=2, padding=1, bias=False)
    return nn.Sequential(conv, nn.BatchNorm2d(out_channels), nn.Dropout(dropout), nn.ReLU())


def way_down(channels: Sequence[int]) -> nn.ModuleList:
    """Blocks from the image to the innermost map, whose outputs have these numbers of channels."""
    last = len(channels) - 1
    later = [halve(channels[i - 1], channels[i], norm=i < last) for i in range(1, last + 1)]
    return nn.ModuleList([halve(3, channels[0], norm=False), *later])


def way_up(channels: Sequence[int]) -> nn.ModuleList:
    """Blocks from the innermost map to the one at 1/2; all but the first also take the skip connection."""
    later = [
        double(2 * channels[i], channels[i - 1], dropout=0.5 if i >= LEAST_DOWNS - 1 else 0.0)
        for i in range(len(channels) - 2, 0, -1)
    ]
    return nn.ModuleList([double(channels[-1], channels[-2]), *later])


@register_model(
    "pix2pix", loss="pix2pix", task="adversarial", presets=SMALLER, label="pix2pix", colour="#E69F00"
)
class Pix2Pix(DepthNetwork):
    """U-Net generator of pix2pix: image in [-1, 1] -> depth in [-1, 1], which is [0, max_depth] mm.

    64-128-256-512-512... channels on the way down; on the way up as many again beside the skip connections.
    The first map and the innermost have no batch norm, so that a batch of one trains with 1 x 1 innermost
    pixel. Up blocks from 1024 channels to 512 have dropout: downs - 5 of them, three as published.

    Differs from the authors' code: the number of downs follows the size (`downs_for`); 8 are published. The
    image comes normalised as to the other networks and is turned back to [-1, 1] inside, which is linear. In
    evaluation mode dropout is off and batch norms use running statistics; the authors leave both on.

    Features for other decoders: at 1/2 and 1/4 the maps of the way down, after LeakyReLU; at 1/8 the input of
    the next up block, which is the up map beside the skip connection, after ReLU.

    Args:
        encoder: "none": the generator has one of its own.
        max_depth: upper bound of the depth in mm.
        pretrained: None: there are no weights to start from.
        width: F; the first map has F/8 channels. 512 is published.
        size_hw: height and width of the images it will train on, which give the number of downs; None is the
            published 256 x 256.

    Attributes:
        downs: number of times the image is halved; its sides are padded to multiples of 2**downs.

    Raises:
        ValueError: an encoder or weights are given, or the width is not a positive multiple of 8.

    References:
        Isola et al., Image-to-Image Translation with Conditional Adversarial Networks, CVPR 2017, section
        3.2.1 and appendix 6.1.1.
    """

    memory_format = torch.contiguous_format

    def __init__(
        self,
        encoder: str = "none",
        max_depth: MaxDepth = 100.0,
        pretrained: str | None = None,
        width: Width = 512,
        size_hw: tuple[int, int] | None = None,
    ) -> None:
        super().__init__()
        _refuse_encoder(encoder, pretrained)
        if width <= 0 or width % 8:
            raise OptionError(f"model.width: must be a positive multiple of 8, got {width}")
        self.max_depth = max_depth
        self.downs = downs_for(size_hw or PUBLISHED_SIZE)
        self.multiple = 2**self.downs
        channels = [width // 8 * min(2**i, 8) for i in range(self.downs)]
        self.feature_channels = (channels[0], channels[1], 2 * channels[2])
        self.encoder, self.decoder = way_down(channels), way_up(channels)
        self.head = nn.ConvTranspose2d(2 * channels[0], 1, 4, stride=2, padding=1)
        init_normal(self)

    def estimate(self, x: Float[Tensor, "b 3 h w"]) -> tuple[Float[Tensor, "b 1 h w"], Features]:
        """Depth in mm, the maps at 1/2 and 1/4 of the way down, and the one at 1/8 of the way up."""
        falling = self._fall(2 * (x * self.std + self.mean) - 1)
        rising = self._rise(falling)
        return self._depth(rising[-1]), Features(falling[0], falling[1], rising[-3])

    def _fall(self, x: Tensor) -> list[Tensor]:
        maps = []
        for down in self.encoder:
            x = down(x)
            maps.append(x)
        return maps

    def _rise(self, falling: list[Tensor]) -> list[Tensor]:
        *skips, x = falling
        x, maps = x.relu(), []
        for up, skip in zip(self.decoder, reversed(skips), strict=True):
            x = torch.cat([skip.relu(), up(x)], dim=1)
            maps.append(x)
        return maps

    def _depth(self, x: Tensor) -> Tensor:
        # (tanh(z) + 1) / 2 = sigmoid(2 z), which does not cancel where the depth is small.
        with torch.autocast(x.device.type, enabled=False):
            z = at_least_float32(self.head(x.to(self.head.weight.dtype)))
            return self.max_depth * torch.sigmoid(2 * z)


def _refuse_encoder(encoder: str, pretrained: str | None) -> None:
    if encoder != "none":
        raise OptionError(f"model.encoder: pix2pix has an encoder of its own; expected none, got {encoder!r}")
    if pretrained not in (None, "none"):
        raise OptionError(
            f"model.pretrained: pix2pix starts from random weights; expected none, got {pretrained!r}"
        )
