"""Networks, one paper a file: image -> `Prediction`."""

from typing import Any

from col3d.checks import check_known
from col3d.layers.network import ImageNetwork
from col3d.models.bts import BTS
from col3d.models.bts_cbam import BTSCBAM
from col3d.models.col3d_mtl import Col3DMTL

NETWORKS: dict[str, type[ImageNetwork]] = {
    "bts": BTS,
    "bts_cbam": BTSCBAM,
    "bts_cbam_mtl": Col3DMTL,
    "col3d_mtl": Col3DMTL,
}


def create(
    name: str,
    encoder: str = "resnet50",
    max_depth: float = 100.0,
    pretrained: str | None = None,
    width: int = 512,
    **options: Any,
) -> ImageNetwork:
    """A network by its name.

    Args:
        name: one of `NETWORKS`.
        encoder: name of a timm model with maps at /2 to /32.
        max_depth: upper bound of the depth in mm.
        pretrained: encoder weights: None, "imagenet" or the path of a file.
        width: what the decoder's sizes scale from; 512 is published, a multiple of 64.
        options: what else the network's own class takes.

    Raises:
        ValueError: the name is unknown, or the encoder does not fit.

    >>> create("bts", encoder="resnet18", width=64).tasks
    ('depth',)
    """
    if max_depth <= 0:
        raise ValueError(f"model.max_depth: expected mm above 0, got {max_depth}")
    network: Any = NETWORKS[check_known("model.name", name, NETWORKS)]
    built: ImageNetwork = network(
        encoder=encoder, max_depth=max_depth, pretrained=pretrained, width=width, **options
    )
    return built
