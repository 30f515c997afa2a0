"""NeWCRFs: depth through fully connected conditional random fields inside windows."""

from collections import OrderedDict
from collections.abc import Callable

import torch
from jaxtyping import Float
from torch import Tensor, nn

from col3d.errors import OptionError
from col3d.geometry.precision import at_least_float32
from col3d.layers.network import DepthNetwork
from col3d.layers.normal_decoder import Features
from col3d.layers.swin import Swin
from col3d.layers.window_attention import WINDOW, WindowBlock
from col3d.models.options import MaxDepth, Width, with_encoder
from col3d.nearest_names import check_known
from col3d.registry import register_model

POOLS = (1, 2, 3, 6)


def pairs_norm(channels: int) -> nn.GroupNorm:
    """Group norm with two channels in each group: 256 groups of 512."""
    return nn.GroupNorm(channels // 2, channels)


PYRAMID_NORMS: dict[str, Callable[[int], nn.Module]] = {"group": pairs_norm, "batch": nn.BatchNorm2d}


def conv_norm_relu(
    in_channels: int, out_channels: int, kernel: int, norm: Callable[[int], nn.Module]
) -> nn.Sequential:
    """A same-size convolution without bias, a norm and ReLU; weights are Kaiming-normal by fan-out."""
    conv = nn.Conv2d(in_channels, out_channels, kernel, padding=kernel // 2, bias=False)
    nn.init.kaiming_normal_(conv.weight, mode="fan_out", nonlinearity="relu")
    return nn.Sequential(OrderedDict(conv=conv, norm=norm(out_channels), relu=nn.ReLU()))


def cell_means(x: Float[Tensor, "b c h w"], cells: int) -> Float[Tensor, "b c {cells} {cells}"]:
    """Means over `cells` x `cells` cells, which overlap where the sides are no multiples."""
    if not torch.compiler.is_exporting():
        return nn.functional.adaptive_avg_pool2d(x, cells)
    rows, columns = (_shares(length, cells).to(x) for length in x.shape[2:])
    return rows @ x @ columns.T


def _shares(length: int, cells: int) -> Float[Tensor, "{cells} length"]:
    """Weight of each pixel of a row in each cell's mean; exporters accept it for rows of any length."""
    place, cell = torch.arange(length), torch.arange(cells)[:, None]
    inside = (place >= cell * length // cells) & (place < ((cell + 1) * length + cells - 1) // cells)
    return inside / inside.sum(dim=1, keepdim=True)


class PyramidPooling(nn.Module):
    """The map and its means over 1, 2 x 2, 3 x 3 and 6 x 6 cells, fused by a 3x3 convolution.

    Args:
        in_channels: channels of the map.
        channels: channels of each pooled map and of the result.
        norm: makes the norm of a pooled map from its number of channels.

    References:
        Zhao et al., Pyramid Scene Parsing Network, CVPR 2017, figure 3.
    """

    def __init__(self, in_channels: int, channels: int, norm: Callable[[int], nn.Module]) -> None:
        super().__init__()
        self.pooled = nn.ModuleList(conv_norm_relu(in_channels, channels, 1, norm) for _ in POOLS)
        self.fuse = conv_norm_relu(in_channels + len(POOLS) * channels, channels, 3, nn.BatchNorm2d)

    def forward(self, x: Float[Tensor, "b _ h w"]) -> Float[Tensor, "b _ h w"]:
        """A map -> a map of the same size with global context."""
        maps = [x]
        for cells, reduce in zip(POOLS, self.pooled, strict=True):
            pooled = reduce(cell_means(x, cells))
            maps.append(nn.functional.interpolate(pooled, size=x.shape[2:], mode="bilinear"))
        fused: Tensor = self.fuse(torch.cat(maps, dim=1))
        return fused


class NeuralCRF(nn.Module):
    """One stage: values predicted by the stage above, weighted by the similarity of the encoder's pixels.

    Args:
        in_channels: channels of the encoder's map.
        channels: channels of the stage; the map from the stage above has half as many.
        heads: number of attention heads.

    References:
        Yuan et al., Neural Window Fully-connected CRFs for Monocular Depth Estimation, CVPR 2022, section 3.
    """

    def __init__(self, in_channels: int, channels: int, heads: int) -> None:
        super().__init__()
        fits = in_channels == channels
        self.to_x = nn.Identity() if fits else nn.Conv2d(in_channels, channels, 3, padding=1)
        self.to_value = nn.Conv2d(channels // 2, channels, 3, padding=1)
        self.blocks = nn.ModuleList(
            WindowBlock(channels, heads, shift, own_value=False) for shift in (0, WINDOW // 2)
        )
        self.norm = nn.LayerNorm(channels)

    def forward(
        self, x: Float[Tensor, "b _ h w"], above: Float[Tensor, "b _ h w"]
    ) -> Float[Tensor, "b _ h w"]:
        """The encoder's map and the upper stage's of the same size -> this stage's."""
        x, value = self.to_x(x).permute(0, 2, 3, 1), self.to_value(above).permute(0, 2, 3, 1)
        for block in self.blocks:
            x = block(x, value)
        refined: Tensor = self.norm(x).permute(0, 3, 1, 2)
        return refined


@register_model(
    "newcrfs",
    loss="silog",
    presets=with_encoder("swin_tiny_patch4_window7_224"),
    label="NeWCRFs",
    colour="#009E73",
)
class NeWCRFs(DepthNetwork):
    """Swin, pyramid pooling, and four stages of neural CRFs from /32 to /4, where depth is estimated.

    Differs from the authors' code in one place: images of any size are padded to a multiple of 32 internally.

    Their code gives the pooled maps group norm of 256 groups (`pyramid_norm="group"`), so that one image can
    be a batch; of the 1 x 1 map it leaves little more than which of two channels is larger. Weights of
    programs in which these are batch norms, with running statistics, need `pyramid_norm="batch"`.

    Args:
        encoder: name of a Swin of timm with windows of 7; large is published.
        max_depth: upper bound of the depth in mm.
        pretrained: encoder weights: None, "imagenet" (22k where the name has no tag) or the path of a file.
        width: channels of the pyramid; the stages have 2, 1, 1/2 and 1/4 times as many. 512 is published, a
            multiple of 64.
        pyramid_norm: "group" or "batch".

    Raises:
        ValueError: the encoder, the width or the norm does not fit.

    References:
        Yuan et al., Neural Window Fully-connected CRFs for Monocular Depth Estimation, CVPR 2022, figure 3.
    """

    def __init__(
        self,
        encoder: str = "swin_large_patch4_window7_224",
        max_depth: MaxDepth = 100.0,
        pretrained: str | None = None,
        width: Width = 512,
        pyramid_norm: str = "group",
    ) -> None:
        super().__init__()
        if width <= 0 or width % 64:
            raise OptionError(f"model.width: must be a positive multiple of 64, got {width}")
        norm = PYRAMID_NORMS[check_known("model.pyramid_norm", pyramid_norm, PYRAMID_NORMS)]
        self.max_depth = max_depth
        self.encoder = Swin(encoder, pretrained)
        at4, at8, at16, at32 = self.encoder.channels
        self.feature_channels = (0, at4, width // 2)
        self.pyramid = PyramidPooling(at32, width, norm)
        self.crf32 = NeuralCRF(at32, 2 * width, heads=32)
        self.crf16 = NeuralCRF(at16, width, heads=16)
        self.crf8 = NeuralCRF(at8, width // 2, heads=8)
        self.crf4 = NeuralCRF(at4, width // 4, heads=4)
        self.head = nn.Conv2d(width // 4, 1, 3, padding=1)

    def estimate(self, x: Float[Tensor, "b 3 h w"]) -> tuple[Float[Tensor, "b 1 h w"], Features]:
        """Depth in mm, the encoder's map at 1/4 and that of the CRFs at 1/8; there is none at 1/2."""
        at4, at8, at16, at32 = self.encoder(x)
        crf32 = self.crf32(at32, self.pyramid(at32))
        crf16 = self.crf16(at16, nn.functional.pixel_shuffle(crf32, 2))
        crf8 = self.crf8(at8, nn.functional.pixel_shuffle(crf16, 2))
        crf4 = self.crf4(at4, nn.functional.pixel_shuffle(crf8, 2))
        absent = x.new_zeros(x.shape[0], 0, x.shape[2] // 2, x.shape[3] // 2)
        return self._depth(crf4), Features(absent, at4, crf8)

    def _depth(self, x: Float[Tensor, "b _ h4 w4"]) -> Float[Tensor, "b 1 h w"]:
        with torch.autocast(x.device.type, enabled=False):
            fraction = torch.sigmoid(at_least_float32(self.head(x.to(self.head.weight.dtype))))
            return self.max_depth * nn.functional.interpolate(fraction, scale_factor=4, mode="bilinear")
