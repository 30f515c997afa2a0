"""Every network, as small as it gets."""

from col3d.layers.network import DepthNetwork
from col3d.models import create

ENCODERS = {"newcrfs": "swin_tiny_patch4_window7_224", "pix2pix": "none"}


def small(name: str, **options: object) -> DepthNetwork:
    if name == "pix2pix":
        options["size"] = (64, 64)
    return create(name, encoder=ENCODERS.get(name, "resnet18"), width=64, **options)
