"""PatchGAN, the discriminator of pix2pix, and the weight initialisation of adversarial networks."""

from jaxtyping import Float
from torch import Tensor, nn

from col3d.errors import OptionError

STD = 0.02


def init_normal(module: nn.Module) -> None:
    """Draw weights of convolutions from N(0, 0.02), of batch norms from N(1, 0.02); biases zero.

    References:
        Isola et al., Image-to-Image Translation with Conditional Adversarial Networks, CVPR 2017,
        appendix 6.2; the start of batch norms is that of the authors' code.
    """
    for layer in module.modules():
        if isinstance(layer, nn.Conv2d | nn.ConvTranspose2d | nn.BatchNorm2d):
            nn.init.normal_(layer.weight, float(isinstance(layer, nn.BatchNorm2d)), STD)
            if layer.bias is not None:
                nn.init.zeros_(layer.bias)


def halve(in_channels: int, out_channels: int, norm: bool = True, bias: bool = False) -> nn.Sequential:
    """4x4 convolution of stride 2, [batch norm,] LeakyReLU 0.2: half the height and width."""
    conv = nn.Conv2d(in_channels, out_channels, 4, stride=2, padding=1, bias=bias)
    normed: list[nn.Module] = [conv, nn.BatchNorm2d(out_channels)] if norm else [conv]
    return nn.Sequential(*normed, nn.LeakyReLU(0.2))


class PatchGAN(nn.Module):
    """Classifies each patch of 70 x 70 pixels, of image and depth together, as real or not.

    Three 4x4 convolutions of stride 2 and two of stride 1, with 64, 128, 256, 512 and 1 channels at the
    published width; all but the first and the last are batch-normalised.

    Args:
        in_channels: channels of image and depth together.
        width: F, as for the generator; the first convolution has F/8 channels. 512 is published.

    Raises:
        ValueError: the width is not a positive multiple of 8.

    References:
        Isola et al., Image-to-Image Translation with Conditional Adversarial Networks, CVPR 2017,
        section 3.2.2 and appendix 6.1.2.
    """

    def __init__(self, in_channels: int = 4, width: int = 512) -> None:
        super().__init__()
        if width <= 0 or width % 8:
            raise OptionError(f"model.width: must be a positive multiple of 8, got {width}")
        base = width // 8
        last = nn.Conv2d(4 * base, 8 * base, 4, padding=1, bias=False)
        self.layers = nn.Sequential(
            halve(in_channels, base, norm=False, bias=True),
            halve(base, 2 * base),
            halve(2 * base, 4 * base),
            nn.Sequential(last, nn.BatchNorm2d(8 * base), nn.LeakyReLU(0.2)),
            nn.Conv2d(8 * base, 1, 4, padding=1),
        )
        init_normal(self)

    def forward(self, pair: Float[Tensor, "b _ h w"]) -> Float[Tensor, "b 1 _ _"]:
        """Image and depth, both in [-1, 1], concatenated in this order -> a logit per patch, real above 0.

        A patch's middle moves by 8 pixels from one logit to the next; 256 x 256 pixels have 30 x 30 logits.
        """
        logits: Tensor = self.layers(pair)
        return logits
