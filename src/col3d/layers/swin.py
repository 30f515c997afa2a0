"""Swin encoder for dense prediction, with weights by timm's names or by Microsoft's."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from jaxtyping import Float
from torch import Tensor, nn

from col3d.errors import OptionError
from col3d.layers.encoder import fill_encoder, read_encoder_weights, refuse_more_blocks
from col3d.layers.window_attention import WINDOW, WindowBlock
from col3d.nearest_names import nearest_name

HEAD_CHANNELS = 32


class Size(NamedTuple):
    """Channels at /4, which double from scale to scale, and blocks of each stage."""

    channels: int
    depths: tuple[int, int, int, int]


SIZES = {
    "swin_tiny_patch4_window7_224": Size(96, (2, 2, 6, 2)),
    "swin_small_patch4_window7_224": Size(96, (2, 2, 18, 2)),
    "swin_base_patch4_window7_224": Size(128, (2, 2, 18, 2)),
    "swin_large_patch4_window7_224": Size(192, (2, 2, 18, 2)),
}


class PatchEmbedding(nn.Module):
    """One token for each 4 x 4 patch of the image, normalised."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.proj = nn.Conv2d(3, channels, 4, stride=4)
        self.norm = nn.LayerNorm(channels)

    def forward(self, image: Float[Tensor, "b 3 h w"]) -> Float[Tensor, "b h4 w4 c"]:
        """An image whose sides are multiples of 4 -> its tokens."""
        tokens: Tensor = self.norm(self.proj(image).permute(0, 2, 3, 1))
        return tokens


class PatchMerging(nn.Module):
    """Concatenate each 2 x 2 square (columns before rows), normalise, and map to twice the channels."""

    def __init__(self, in_channels: int) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(4 * in_channels)
        self.reduction = nn.Linear(4 * in_channels, 2 * in_channels, bias=False)

    def forward(self, x: Float[Tensor, "b h w c"]) -> Float[Tensor, "b h2 w2 2*c"]:
        """A map with even sides -> half the height and width."""
        b, height, width, c = x.shape
        squares = x.reshape(b, height // 2, 2, width // 2, 2, c).permute(0, 1, 3, 4, 2, 5)
        merged: Tensor = self.reduction(self.norm(squares.flatten(3)))
        return merged


class Stage(nn.Module):
    """Patch merging (not in the first stage), then blocks with plain and with shifted windows in turn."""

    def __init__(self, channels: int, drop_paths: list[float], merge: bool) -> None:
        super().__init__()
        self.downsample = PatchMerging(channels // 2) if merge else nn.Identity()
        self.blocks = nn.Sequential(
            *(
                WindowBlock(channels, channels // HEAD_CHANNELS, i % 2 * (WINDOW // 2), drop_path)
                for i, drop_path in enumerate(drop_paths)
            )
        )

    def forward(self, x: Float[Tensor, "b h w _"]) -> Float[Tensor, "b _ _ _"]:
        """The map of the stage above -> this stage's."""
        out: Tensor = self.blocks(self.downsample(x))
        return out


class Swin(nn.Module):
    """Feature maps at 1/4, 1/8, 1/16 and 1/32 of the image, each through a LayerNorm of its own.

    timm's Swin rolls a map before it pads it to whole windows, and does not shift the windows of a map of one
    window. The networks published for segmentation and depth differ in both, so that timm's is another
    function wherever a map's side is no multiple of 7 above 7.

    Args:
        name: one of `SIZES`; a tag chooses its weights, as in `swin_tiny_patch4_window7_224.ms_in1k`, and
            those of ImageNet-22k are taken where there is none.
        pretrained: None for random weights, "imagenet" to fetch timm's, or the path of a local file with
            timm's or Microsoft's names. The four LayerNorms are initialised anew in any case.
        drop_path: probability of dropping the last block's residuals in training, and the earlier ones in
            proportion; 0.3 is NeWCRFs'.

    Attributes:
        channels: channels of the four maps, the largest map first.

    Raises:
        ValueError: the name is not one of such a Swin, or its weights are not available.

    References:
        Liu et al., Swin Transformer: Hierarchical Vision Transformer using Shifted Windows, ICCV 2021.
    """

    def __init__(self, name: str, pretrained: str | None = None, drop_path: float = 0.3) -> None:
        super().__init__()
        first, depths = _size(name)
        self.channels = [first * 2**i for i in range(4)]
        self.patch_embed = PatchEmbedding(first)
        rates = iter([drop_path * i / (sum(depths) - 1) for i in range(sum(depths))])
        self.layers = nn.ModuleList(
            Stage(channels, [next(rates) for _ in range(depth)], merge=channels > first)
            for channels, depth in zip(self.channels, depths, strict=True)
        )
        self.norms = nn.ModuleList(nn.LayerNorm(channels) for channels in self.channels)
        self.apply(_init)
        if pretrained == "imagenet":
            _fill(self, _fetched(name), name)
        elif pretrained not in (None, "none"):
            _fill(self, read_encoder_weights(Path(str(pretrained))), repr(str(pretrained)))

    def forward(self, image: Float[Tensor, "b 3 h w"]) -> list[Float[Tensor, "b _ _ _"]]:
        """A normalised image whose sides are multiples of 32 -> four maps, the largest first."""
        x, taps = self.patch_embed(image), []
        for stage, norm in zip(self.layers, self.norms, strict=True):
            x = stage(x)
            taps.append(norm(x).permute(0, 3, 1, 2))
        return taps


def _size(name: str) -> Size:
    plain, _, tag = name.partition(".")
    if plain not in SIZES:
        known = ", ".join(SIZES)
        raise OptionError(
            f"model.encoder: newcrfs needs a Swin, one of {known}; got {name!r}{nearest_name(plain, SIZES)}"
        )
    if tag:
        _check_tag(name, plain)
    return SIZES[plain]


def _check_tag(name: str, plain: str) -> None:
    import timm

    tagged = timm.list_models(f"{plain}.*", pretrained=True)
    if name not in tagged:
        raise OptionError(f"model.encoder: timm has no weights {name!r}{nearest_name(name, tagged)}")


def _init(module: nn.Module) -> None:
    if isinstance(module, nn.Linear):
        nn.init.trunc_normal_(module.weight, std=0.02)
        if module.bias is not None:
            nn.init.zeros_(module.bias)


def _fetched(name: str) -> Mapping[str, Tensor]:
    import timm

    tagged = name if "." in name else f"{name}.ms_in22k"
    try:
        return timm.create_model(tagged, pretrained=True).state_dict()
    except Exception as error:
        raise OptionError(
            f"model.pretrained: no weights {tagged!r} could be fetched ({type(error).__name__}); "
            "say model.pretrained=none for random weights or model.pretrained=<path of a weight file>"
        ) from error


def _fill(net: Swin, stored: Mapping[str, Tensor], source: str) -> None:
    if "layers.0.downsample.norm.weight" in stored:
        stored = {timm_name(name): value for name, value in stored.items()}
    own = {name: value for name, value in net.state_dict().items() if not name.startswith("norms.")}
    fill_encoder(net, own, stored, source)
    refuse_more_blocks(list(own), [name for name in stored if name not in own], source)


def timm_name(name: str) -> str:
    """Convert a name of Microsoft's release to timm's: the end of a stage begins the next one here.

    >>> timm_name("layers.0.downsample.norm.bias")
    'layers.1.downsample.norm.bias'
    """
    return re.sub(r"^layers\.(\d)\.downsample", lambda stage: f"layers.{int(stage[1]) + 1}.downsample", name)
