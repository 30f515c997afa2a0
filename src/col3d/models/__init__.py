"""Networks, one paper a file: image -> `Prediction`."""

from typing import Any

from col3d.checks import check_known
from col3d.layers.network import DepthNetwork
from col3d.layers.normal_decoder import NORMAL_FRAMES
from col3d.models.bts import BTS
from col3d.models.bts_cbam import BTSCBAM
from col3d.models.col3d_mtl import Col3DMTL
from col3d.models.monodepth_fpn import MonoDepthFPN
from col3d.models.newcrfs import NeWCRFs
from col3d.models.pix2pix import Pix2Pix

NETWORKS: dict[str, type[DepthNetwork]] = {
    "bts": BTS,
    "bts_cbam": BTSCBAM,
    "bts_cbam_mtl": Col3DMTL,
    "col3d_mtl": Col3DMTL,
    "newcrfs": NeWCRFs,
    "monodepth_fpn": MonoDepthFPN,
    "pix2pix": Pix2Pix,
}
NORMALS = ("none", "unc")
WITH_NORMALS = ("bts_cbam_mtl", "col3d_mtl")
"""Networks that are defined by their decoder for normals."""


def create(
    name: str,
    encoder: str | None = None,
    max_depth: float = 100.0,
    pretrained: str | None = None,
    width: int = 512,
    normals: str | None = None,
    normal_frame: str = "camera",
    **options: Any,
) -> DepthNetwork:
    """A network by its name.

    * `bts` (Lee et al. 2019): local planar guidance; ResNet-50.
    * `bts_cbam`: BTS whose decoder attends to its features.
    * `bts_cbam_mtl`, `col3d_mtl` (Chavarrias Solano et al. 2023): BTS-CBAM with a decoder for normals; the
      two are one network, trained without and with a cross-task loss.
    * `newcrfs` (Yuan et al. 2022): a Swin encoder, window-wise conditional random fields; Swin-Large.
    * `monodepth_fpn`: a feature pyramid, after public code, for the paper gives no layers; ResNet-50.
    * `pix2pix` (Isola et al. 2017): a U-Net of its own; `size`, as an option, sets its depth.

    Args:
        name: one of `NETWORKS`.
        encoder: name of a timm model with maps at /2 to /32, of a Swin for `newcrfs`, "none" for `pix2pix`;
            the published one when absent.
        max_depth: upper bound of the depth in mm.
        pretrained: encoder weights: None, "imagenet" or the path of a file.
        width: what the decoder's sizes scale from; 512 is published, a multiple of 64.
        normals: "unc" adds a decoder of normals, "none" does not; absent, the network's own habit.
        normal_frame: what predicted normals are measured from: "camera", anywhere on the sphere; or "ray",
            always facing the camera, for which the network is called as `network(image, rays)`.
        options: what else the network's own class takes.

    Raises:
        ValueError: the name is unknown, or the encoder or the normals do not fit.

    >>> create("bts", encoder="resnet18", width=64).tasks
    ('depth',)
    >>> create("bts", encoder="resnet18", width=64, normals="unc").tasks
    ('depth', 'normals')
    """
    if max_depth <= 0:
        raise ValueError(f"model.max_depth: expected mm above 0, got {max_depth}")
    kind: Any = NETWORKS[check_known("model.name", name, NETWORKS)]
    check_known("model.normal_frame", normal_frame, NORMAL_FRAMES)
    options |= {} if encoder is None else {"encoder": encoder}
    if name in WITH_NORMALS:
        if normals == "none":
            raise ValueError(f"model.normals: {name} always predicts normals; take bts_cbam for depth alone")
        options["normal_frame"] = normal_frame
    elif normal_frame == "ray" and normals != "unc":
        raise ValueError("model.normal_frame: ray is for predicted normals; take normals=unc")
    network: DepthNetwork = kind(max_depth=max_depth, pretrained=pretrained, width=width, **options)
    asked = normals is not None and check_known("model.normals", normals, NORMALS) == "unc"
    if asked and network.normal_decoder is None:
        network.add_normals(width, normal_frame)
    return network.to(memory_format=network.memory_format)
