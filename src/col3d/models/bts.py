"""BTS: depth through local planes."""

from typing import ClassVar

from jaxtyping import Float
from torch import Tensor

from col3d.batch import Prediction
from col3d.layers.aspp import DenseTrunk
from col3d.layers.conv import init_xavier
from col3d.layers.depth_decoder import DepthDecoder
from col3d.layers.encoder import Encoder
from col3d.layers.network import ImageNetwork


class BTS(ImageNetwork):
    """Encoder, dense ASPP, and a decoder that is guided by local planes at 1/8, 1/4 and 1/2.

    Differs from the authors' code in two places: images of any size are padded to a multiple of 32 inside,
    and n1 u + n2 v + n3 is kept away from 0, where a plane's depth is not finite.

    Args:
        encoder: name of a timm model with maps at /2 to /32.
        max_depth: upper bound of the depth in mm.
        pretrained: encoder weights: None, "imagenet" or the path of a file.
        width: F, which the decoder's sizes scale from; 512 is published, a multiple of 64.

    References:
        Lee et al., From Big to Small: Multi-Scale Local Planar Guidance for Monocular Depth Estimation,
        arXiv:1907.10326, 2019, figure 2.
    """

    tasks: ClassVar[tuple[str, ...]] = ("depth",)

    def __init__(
        self,
        encoder: str = "resnet50",
        max_depth: float = 100.0,
        pretrained: str | None = None,
        width: int = 512,
    ) -> None:
        super().__init__()
        self.encoder = Encoder(encoder, pretrained)
        self.trunk = DenseTrunk(self.encoder.channels, width)
        self.depth_decoder = DepthDecoder(self.encoder.channels, width, max_depth)
        init_xavier(self.trunk)
        init_xavier(self.depth_decoder)

    def predict(self, x: Float[Tensor, "b 3 h w"]) -> Prediction:
        """Depth for a normalised image whose sides are multiples of 32."""
        features = self.encoder(x)
        return {"depth": self.depth_decoder(self.trunk(features), *features[:2])}
