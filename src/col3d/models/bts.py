"""BTS: depth through local planes."""

from collections.abc import Callable

from jaxtyping import Float
from torch import Tensor, nn

from col3d.layers.aspp import DenseTrunk
from col3d.layers.conv import init_xavier
from col3d.layers.depth_decoder import DepthDecoder, FinestDepth
from col3d.layers.encoder import Encoder
from col3d.layers.network import DepthNetwork
from col3d.layers.normal_decoder import Features
from col3d.models.options import MaxDepth, Width, with_encoder
from col3d.registry import register_model


@register_model("bts", loss="silog", presets=with_encoder("resnet18"), label="BTS", colour="#0072B2")
class BTS(DepthNetwork):
    """Encoder, dense ASPP, and a decoder that is guided by local planes at 1/8, 1/4 and 1/2.

    Differs from the authors' code in two places: images of any size are padded to a multiple of 32
    internally, and n1 u + n2 v + n3 is kept away from 0, where a plane's depth is not finite.

    Args:
        encoder: name of a timm model with maps at /2 to /32.
        max_depth: upper bound of the depth in mm.
        pretrained: encoder weights: None, "imagenet" or the path of a file.
        width: F, which the decoder's sizes scale from; 512 is published, a multiple of 64.
        attention: makes the attention block for a number of channels; none in BTS.
        finest: makes the block that estimates depth at full size from a number of channels.

    References:
        Lee et al., From Big to Small: Multi-Scale Local Planar Guidance for Monocular Depth Estimation,
        arXiv:1907.10326, 2019, figure 2.
    """

    def __init__(
        self,
        encoder: str = "resnet50",
        max_depth: MaxDepth = 100.0,
        pretrained: str | None = None,
        width: Width = 512,
        *,
        attention: Callable[[int], nn.Module] = nn.Identity,
        finest: Callable[[int], nn.Module] = FinestDepth,
    ) -> None:
        super().__init__()
        self.encoder = Encoder(encoder, pretrained)
        at2, at4, *_ = channels = self.encoder.channels
        self.feature_channels = (at2, at4, width // 4)
        self.trunk = DenseTrunk(channels, width)
        self.depth_decoder = DepthDecoder(channels, width, max_depth, attention, finest)
        init_xavier(self.trunk)
        init_xavier(self.depth_decoder)

    def estimate(self, x: Float[Tensor, "b 3 h w"]) -> tuple[Float[Tensor, "b 1 h w"], Features]:
        """Depth in mm, and the maps of the encoder and of the trunk."""
        maps = self.encoder(x)
        features = Features(maps[0], maps[1], self.trunk(maps))
        return self.depth_decoder(features.at8, features.at2, features.at4), features
