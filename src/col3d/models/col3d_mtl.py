"""Col3D-MTL: BTS-CBAM with a second decoder for surface normals."""

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from col3d.geometry import unit
from col3d.layers.normal_decoder import NormalDecoder, NormalFrame
from col3d.layers.planar import cone_normals
from col3d.models.bts_cbam import BTSCBAM
from col3d.models.options import MaxDepth, Width, with_encoder
from col3d.registry import register_model


def published_normals(raw: Float[Tensor, "b 3 h w"]) -> Float[Tensor, "b 3 h w"]:
    """The authors' activations: tanh for x and y, a sigmoid for z; y up, not unit length."""
    return torch.cat([raw[:, :2].tanh(), raw[:, 2:].sigmoid()], dim=1)


def standard_from_published(raw: Float[Tensor, "b 3 h w"]) -> Float[Tensor, "b 3 h w"]:
    """Unit normals in standard axes, facing the camera, from the authors' last convolution."""
    x, y, z = published_normals(raw).split(1, dim=1)
    return unit(torch.cat([x, -y, -z], dim=1))


PUBLISHED = NormalFrame(
    lambda two, _: cone_normals(two), lambda normals, _: normals, lambda raw, _: standard_from_published(raw)
)


NORMALS_TOO: dict[str, Any] = {
    "predicts": ("depth", "normals"),
    "depth_alone": "bts_cbam",
    "presets": with_encoder("resnet18"),
}


@register_model("col3d_mtl", loss="mtl_xtc", **NORMALS_TOO, label="Col3D-MTL", colour="#D55E00")
@register_model("bts_cbam_mtl", loss="mtl", **NORMALS_TOO, label="BTS-CBAM-MTL", colour="#000000")
class Col3DMTL(BTSCBAM):
    """One encoder and trunk, BTS-CBAM's decoder for depth, a decoder with UNC blocks for normals.

    BTS-CBAM-MTL is the same network; Col3D-MTL adds a cross-task loss when it is trained.

    Differs from the authors' code in these places besides those of `BTSCBAM`. Their normals have z in (0,
    1) and y up, as C3VD stored them before May 2023, and no unit length; here they are unit vectors in
    standard axes, anywhere on the sphere. Their UNC blocks measure the polar angle from +z over (0, pi / 3),
    here it is from -z over (0, pi). The last convolutions have biases here, and start at (0, 0, -1). What
    no output depends on is left out. `heads="published"` restores their angles and activations, for their
    weights; the prediction is in standard axes all the same.

    Args:
        encoder: name of a timm model with maps at /2 to /32.
        max_depth: upper bound of the depth in mm.
        pretrained: encoder weights: None, "imagenet" or the path of a file.
        width: F, which the decoders' sizes scale from; 512 is published, a multiple of 64.
        heads: "standard" or "published".
        normal_frame: "camera" or "ray"; see `DepthNetwork.add_normals`. Published heads are in the camera's.

    References:
        Chavarrias Solano et al., Multi-task learning with cross-task consistency for improved depth
        estimation in colonoscopy, arXiv:2311.18664, 2023, the framework's figure.
    """

    def __init__(
        self,
        encoder: str = "resnet50",
        max_depth: MaxDepth = 100.0,
        pretrained: str | None = None,
        width: Width = 512,
        heads: str = "standard",
        normal_frame: str = "camera",
    ) -> None:
        super().__init__(encoder, max_depth, pretrained, width, heads)
        if heads == "published":
            self.normal_decoder = NormalDecoder(self.feature_channels, width, PUBLISHED, bias=False)
        else:
            self.add_normals(width, normal_frame)
