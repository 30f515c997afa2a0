"""Col3D-MTL: BTS-CBAM with a second decoder for surface normals."""

from collections.abc import Callable, Sequence
from typing import ClassVar

import torch
from jaxtyping import Float
from torch import Tensor, nn

from col3d.batch import Prediction
from col3d.checks import check_known
from col3d.geometry import unit
from col3d.layers.aspp import DenseTrunk
from col3d.layers.cbam import CBAM
from col3d.layers.conv import UpConv, UpFuse, conv_elu, init_xavier
from col3d.layers.depth_decoder import DepthDecoder
from col3d.layers.encoder import Encoder
from col3d.layers.network import ImageNetwork
from col3d.layers.planar import UnitNormal, cone_normals, sphere_normals
from col3d.models.bts_cbam import FINEST_DEPTH
from col3d.precision import at_least_float32


def enlarge(x: Float[Tensor, "b c h w"], factor: int) -> Float[Tensor, "b c {factor}*h {factor}*w"]:
    """Every value repeated over a `factor` x `factor` patch."""
    return nn.functional.interpolate(x, scale_factor=factor, mode="nearest")


def published_normals(raw: Float[Tensor, "b 3 h w"]) -> Float[Tensor, "b 3 h w"]:
    """What the authors' decoder ends in: x and y through tanh, z through a sigmoid; y up, not unit length."""
    return torch.cat([raw[:, :2].tanh(), raw[:, 2:].sigmoid()], dim=1)


def house_from_published(raw: Float[Tensor, "b 3 h w"]) -> Float[Tensor, "b 3 h w"]:
    """Unit house normals (x right, y down, z forward, facing the camera) of the authors' last convolution."""
    return unit(published_normals(raw) * raw.new_tensor([1.0, -1.0, -1.0]).view(1, 3, 1, 1))


class NormalDecoder(nn.Module):
    """Unit normals at 1/8, 1/4, 1/2 and full size meet, axis by axis, in the last convolutions.

    Args:
        channels: the encoder's channels at /2, /4, /8, /16 and /32; the first two are skip connections.
        width: F; 512 is published.
        normals: what turns two channels in (0, 1) into the unit normals on the way.
        facing: start near (0, 0, -1), with the biases that takes; otherwise no convolution has a bias.
    """

    def __init__(
        self, channels: Sequence[int], width: int, normals: Callable[[Tensor], Tensor], facing: bool
    ) -> None:
        super().__init__()
        skip2, skip4 = channels[:2]
        f4, f8, f16 = width // 4, width // 8, width // 16
        self.normal8, self.up4 = UnitNormal(f4, f4, normals), UpFuse(f4, f4, skip4 + 3)
        self.normal4, self.up2 = UnitNormal(f4, f8, normals), UpFuse(f4, f8, skip2 + 3)
        self.normal2, self.up1 = UnitNormal(f8, f16, normals), UpConv(f8, f16)
        self.normal1 = UnitNormal(f16, f16 // 2, normals)
        self.fuse = nn.ModuleDict({axis: conv_elu(f16 + 4, f16) for axis in "xyz"})
        self.head = nn.ModuleDict({axis: nn.Conv2d(f16, 1, 3, padding=1, bias=facing) for axis in "xyz"})
        init_xavier(self)
        if facing:
            self._face_the_camera()

    def _face_the_camera(self) -> None:
        for head in self.head.values():
            nn.init.xavier_uniform_(head.get_parameter("weight"), gain=0.1)
        nn.init.constant_(self.head["z"].get_parameter("bias"), -1.0)

    def forward(
        self,
        x: Float[Tensor, "b _ h8 w8"],
        skip2: Float[Tensor, "b _ h2 w2"],
        skip4: Float[Tensor, "b _ h4 w4"],
    ) -> Float[Tensor, "b 3 h w"]:
        """The trunk's map and the encoder's at 1/2 and 1/4 -> x, y, z before any activation, in float32."""
        at8 = self.normal8(x)
        x = self.up4(x, skip4, enlarge(at8, 2))
        at4 = self.normal4(x)
        x = self.up2(x, skip2, enlarge(at4, 2))
        at2 = self.normal2(x)
        x = self.up1(x)
        scales = [self.normal1(x), enlarge(at2, 2), enlarge(at4, 4), enlarge(at8, 8)]
        return torch.cat(
            [self._axis(axis, x, [s[:, i : i + 1] for s in scales]) for i, axis in enumerate("xyz")], 1
        )

    def _axis(self, axis: str, x: Tensor, components: list[Tensor]) -> Tensor:
        fused = self.fuse[axis](torch.cat([x, *components], dim=1))
        with torch.autocast(x.device.type, enabled=False):
            raw: Tensor = self.head[axis](fused.to(self.head[axis].weight.dtype))
        return at_least_float32(raw)


class Col3DMTL(ImageNetwork):
    """One encoder and trunk, BTS-CBAM's decoder for depth, a decoder with UNC blocks for normals.

    BTS-CBAM-MTL is the same network; Col3D-MTL adds a cross-task loss when it is trained.

    Differs from the authors' code in these places besides those of `BTSCBAM`. Their normals have z in (0,
    1) and y up, as C3VD stored them before May 2023, and no unit length; here they are unit vectors in
    house axes, anywhere on the sphere. Their UNC blocks measure the polar angle from +z over (0, pi / 3),
    here it is from -z over (0, pi). The last convolutions have biases here, and start at (0, 0, -1). What
    no output depends on is left out. `heads="published"` brings their angles and activations back, for
    their weights; what is returned is in house axes all the same.

    Args:
        encoder: name of a timm model with maps at /2 to /32.
        max_depth: upper bound of the depth in mm.
        pretrained: encoder weights: None, "imagenet" or the path of a file.
        width: F, which the decoders' sizes scale from; 512 is published, a multiple of 64.
        heads: "house" or "published".

    References:
        Chavarrias Solano et al., Multi-task learning with cross-task consistency for improved depth
        estimation in colonoscopy, arXiv:2311.18664, 2023, the framework's figure.
    """

    tasks: ClassVar[tuple[str, ...]] = ("depth", "normals")

    def __init__(
        self,
        encoder: str = "resnet50",
        max_depth: float = 100.0,
        pretrained: str | None = None,
        width: int = 512,
        heads: str = "house",
    ) -> None:
        super().__init__()
        finest = FINEST_DEPTH[check_known("model.heads", heads, FINEST_DEPTH)]
        house = heads == "house"
        self.house_normals = unit if house else house_from_published
        self.encoder = Encoder(encoder, pretrained)
        channels = self.encoder.channels
        self.trunk = DenseTrunk(channels, width)
        self.depth_decoder = DepthDecoder(channels, width, max_depth, CBAM, finest)
        self.normal_decoder = NormalDecoder(
            channels, width, sphere_normals if house else cone_normals, facing=house
        )
        init_xavier(self.trunk)
        init_xavier(self.depth_decoder)

    def predict(self, x: Float[Tensor, "b 3 h w"]) -> Prediction:
        """Depth and normals for a normalised image whose sides are multiples of 32."""
        features = self.encoder(x)
        context, skips = self.trunk(features), features[:2]
        return {
            "depth": self.depth_decoder(context, *skips),
            "normals": self.house_normals(self.normal_decoder(context, *skips)),
        }
