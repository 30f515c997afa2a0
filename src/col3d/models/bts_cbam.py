"""BTS-CBAM: BTS whose depth decoder attends to its features and skip connections."""

from collections.abc import Callable

from jaxtyping import Float
from torch import Tensor, nn

from col3d.geometry.precision import at_least_float32
from col3d.layers.cbam import CBAM
from col3d.layers.depth_decoder import FinestDepth
from col3d.layers.planar import Reduction, cone_normals, intersect
from col3d.models.bts import BTS
from col3d.models.options import MaxDepth, Width, with_encoder
from col3d.nearest_names import check_known
from col3d.registry import register_model


class PublishedFinestDepth(nn.Module):
    """The authors' depth at full size: distance of a plane over the sum of its normal's components."""

    def __init__(self, in_channels: int) -> None:
        super().__init__()
        self.reduction = Reduction(in_channels, in_channels // 2, 3)

    def forward(self, x: Float[Tensor, "b _ h w"]) -> Float[Tensor, "b 1 h w"]:
        """A map -> fraction of the maximum depth, of any sign."""
        unit = at_least_float32(self.reduction(x)).sigmoid()
        return intersect(unit[:, 2:], cone_normals(unit).sum(dim=1, keepdim=True))


FINEST_DEPTH: dict[str, Callable[[int], nn.Module]] = {
    "standard": FinestDepth,
    "published": PublishedFinestDepth,
}


@register_model(
    "bts_cbam", loss="silog", presets=with_encoder("resnet18"), label="BTS-CBAM", colour="#56B4E9"
)
class BTSCBAM(BTS):
    """BTS with CBAM on the trunk's output, on both skip connections and on the features at 1/4 and 1/2.

    Differs from the authors' code in one place besides those of `BTS`: at full size they divide a distance
    by the sum of a normal's components, which passes through 0; here that depth comes from one sigmoid, as
    in BTS. `heads="published"` restores their quotient, for their weights.

    Args:
        encoder: name of a timm model with maps at /2 to /32.
        max_depth: upper bound of the depth in mm.
        pretrained: encoder weights: None, "imagenet" or the path of a file.
        width: F, which the decoder's sizes scale from; 512 is published, a multiple of 64.
        heads: "standard" or "published".

    References:
        Chavarrias Solano et al., Multi-task learning with cross-task consistency for improved depth
        estimation in colonoscopy, arXiv:2311.18664, 2023.
    """

    def __init__(
        self,
        encoder: str = "resnet50",
        max_depth: MaxDepth = 100.0,
        pretrained: str | None = None,
        width: Width = 512,
        heads: str = "standard",
    ) -> None:
        finest = FINEST_DEPTH[check_known("model.heads", heads, FINEST_DEPTH)]
        super().__init__(encoder, max_depth, pretrained, width, attention=CBAM, finest=finest)
