"""MonoDepth-FPN: depth from a feature pyramid whose levels are fused at 1/4 of the image."""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn

from col3d.errors import OptionError
from col3d.geometry.precision import at_least_float32
from col3d.layers.encoder import Encoder
from col3d.layers.network import DepthNetwork
from col3d.layers.normal_decoder import Features
from col3d.models.options import MaxDepth, Width, with_encoder
from col3d.registry import register_model

FINER = ("at16", "at8", "at4")


def enlarge_smoothly(x: Float[Tensor, "b c h w"], factor: int) -> Float[Tensor, "b c {factor}*h {factor}*w"]:
    """Bilinear up-sampling, pixel centres as in resizing an image: half a pixel from the border."""
    return nn.functional.interpolate(x, scale_factor=factor, mode="bilinear", align_corners=False)


class FeaturePyramid(nn.Module):
    """From the deepest map upwards: smooth(2 x coarser level + 1x1 of the encoder's map), without activation.

    Args:
        channels: the encoder's at /4, /8, /16 and /32.
        width: channels of every level.

    References:
        Lin et al., Feature Pyramid Networks for Object Detection, CVPR 2017, section 3. There each level is
        smoothed beside the top-down path; here the next level is built on the smoothed one.
    """

    def __init__(self, channels: Sequence[int], width: int) -> None:
        super().__init__()
        sizes = zip(("at32", *FINER), reversed(channels), strict=True)
        self.lateral = nn.ModuleDict({name: nn.Conv2d(size, width, 1) for name, size in sizes})
        self.smooth = nn.ModuleDict({name: nn.Conv2d(width, width, 3, padding=1) for name in FINER})

    def forward(self, maps: Sequence[Float[Tensor, "b _ _ _"]]) -> list[Float[Tensor, "b _ _ _"]]:
        """The encoder's maps, the largest first -> levels of the pyramid, the smallest first."""
        *finer, deepest = maps
        levels = [self.lateral["at32"](deepest)]
        for name, fine in zip(FINER, reversed(finer), strict=True):
            levels.append(self.smooth[name](enlarge_smoothly(levels[-1], 2) + self.lateral[name](fine)))
        return levels


def refine(width: int, factor: int) -> nn.Sequential:
    """Two 3x3 ReLU from F/2 to F/4 channels; above factor 1, a third one with a pixel shuffle to enlarge."""
    half, quarter = width // 2, width // 4
    layers: list[nn.Module] = [nn.Conv2d(half, half, 3, padding=1), nn.ReLU()]
    layers += [nn.Conv2d(half, quarter, 3, padding=1), nn.ReLU()]
    if factor > 1:
        layers += [nn.Conv2d(quarter, quarter * factor**2, 3, padding=1), nn.PixelShuffle(factor), nn.ReLU()]
    return nn.Sequential(*layers)


class PyramidDepth(nn.Module):
    """Refine every level to F/4 channels at 1/4 of the image, then two 3x3 convolutions and a sigmoid."""

    def __init__(self, width: int) -> None:
        super().__init__()
        factors = {"at32": 8, "at16": 4, "at8": 2, "at4": 1}
        self.refine = nn.ModuleDict({name: refine(width, factor) for name, factor in factors.items()})
        self.fuse = nn.Sequential(nn.Conv2d(width, width // 4, 3, padding=1), nn.ReLU())
        self.head = nn.Conv2d(width // 4, 1, 3, padding=1)

    def forward(self, levels: Sequence[Float[Tensor, "b _ _ _"]]) -> Float[Tensor, "b 1 h4 w4"]:
        """Levels of the pyramid, the smallest first -> fraction of the maximum depth in (0, 1)."""
        refined = [refine(x) for refine, x in zip(self.refine.values(), levels, strict=True)]
        x = self.fuse(torch.cat(refined, dim=1))
        with torch.autocast(x.device.type, enabled=False):
            return torch.sigmoid(at_least_float32(self.head(x.to(self.head.weight.dtype))))


@register_model(
    "monodepth_fpn",
    loss="monodepth_fpn",
    presets=with_encoder("resnet18"),
    label="MonoDepth+FPN (re-implementation)",
    colour="#CC79A7",
)
class MonoDepthFPN(DepthNetwork):
    """Encoder, feature pyramid, pixel shuffles, one depth map at 1/4 that is enlarged bilinearly.

    This is a re-implementation of a public program by that name. The Col3D-MTL paper compares with "MonoDepth
    + FPN" but gives no layers, so that its network may have been another: say so wherever it is reported.

    Differs from that program: it has ResNet-101, takes images in [0, 1] that are not normalised, and stops at
    1/4 with a depth in (0, 1). Its bilinear up-sampling aligned the corners under the PyTorch 0.3 it was
    written for; under later ones, as here and in the reference numbers, it keeps pixel centres.

    Args:
        encoder: name of a timm model with maps at /2 to /32.
        max_depth: upper bound of the depth in mm.
        pretrained: encoder weights: None, "imagenet" or the path of a file.
        width: F, which the pyramid's (F/2) and the decoder's sizes scale from; 512 is published.

    Raises:
        ValueError: the width is not a positive multiple of 4.

    References:
        I2D: Single Image Depth Estimation with FPN, github.com/haofengac/MonoDepth-FPN-PyTorch, 2018;
        Lin et al., Feature Pyramid Networks for Object Detection, CVPR 2017.
    """

    def __init__(
        self,
        encoder: str = "resnet50",
        max_depth: MaxDepth = 100.0,
        pretrained: str | None = None,
        width: Width = 512,
    ) -> None:
        super().__init__()
        if width <= 0 or width % 4:
            raise OptionError(f"model.width: must be a positive multiple of 4, got {width}")
        self.encoder = Encoder(encoder, pretrained)
        at2, at4, *_ = channels = self.encoder.channels
        self.feature_channels = (at2, at4, width // 2)
        self.max_depth = max_depth
        self.pyramid = FeaturePyramid(channels[1:], width // 2)
        self.depth_decoder = PyramidDepth(width)

    def estimate(self, x: Float[Tensor, "b 3 h w"]) -> tuple[Float[Tensor, "b 1 h w"], Features]:
        """Depth in mm; the encoder's maps at 1/2 and 1/4, and the pyramid's level at 1/8."""
        maps = self.encoder(x)
        levels = self.pyramid(maps[1:])
        depth = self.max_depth * enlarge_smoothly(self.depth_decoder(levels), 4)
        return depth, Features(maps[0], maps[1], levels[2])
