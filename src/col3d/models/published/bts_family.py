"""Map names of BTS's and Col3D-MTL's published tensors to this package's."""

import re
from collections.abc import Mapping
from typing import Any

from torch import Tensor

from col3d.models.bts import BTS
from col3d.models.bts_cbam import BTSCBAM
from col3d.models.col3d_mtl import Col3DMTL
from col3d.models.published.resnets import resnet_name
from col3d.models.published.source import Rules, Source, channels_of

BTS_DECODER: Rules = {
    r"^decoder\.(?=(upconv|bn|conv)[45]\.|bn4_2\.|daspp_)": "daspp.",
    r"^decoder\.": "depth_decoder.",
}
ENCODER: Rules = {r"^encoder\.base_model\.": "encoder.net."}
TRUNK: Rules = {
    r"^daspp\.": "trunk.",
    r"^trunk\.(upconv|bn|conv)5\.": r"trunk.up16.\1.",
    r"^trunk\.(upconv|bn|conv)4\.": r"trunk.up8.\1.",
    r"^trunk\.bn4_2\.": "trunk.norm.",
    r"^trunk\.daspp_conv\.": "trunk.aspp.fuse.",
    r"^trunk\.daspp_3\.": "trunk.aspp.branches.0.",
    r"^trunk\.daspp_6\.": "trunk.aspp.branches.1.",
    r"^trunk\.daspp_12\.": "trunk.aspp.branches.2.",
    r"^trunk\.daspp_18\.": "trunk.aspp.branches.3.",
    r"^trunk\.daspp_24\.": "trunk.aspp.branches.4.",
    r"atrous_conv\.first_bn\.": "norm_in.",
    r"atrous_conv\.aconv_sequence\.1\.": "reduce.",
    r"atrous_conv\.aconv_sequence\.2\.": "norm.",
    r"atrous_conv\.aconv_sequence\.4\.": "atrous.",
}
DECODERS: Rules = {
    r"_normal\.": ".",
    r"_decoder\.(upconv|bn|conv)3\.": r"_decoder.up4.\1.",
    r"_decoder\.(upconv|bn|conv)2\.": r"_decoder.up2.\1.",
    r"_decoder\.upconv1\.": "_decoder.up1.",
    r"(\.up\d+)\.upconv\.": r"\1.up.",
    r"(\.up\d+)\.bn\.": r"\1.norm.",
    r"(\.up\d+)\.conv\.(?=\d)": r"\1.fuse.",
    r"^depth_decoder\.reduc1x1\.": "depth_decoder.finest.",
    r"^depth_decoder\.reduc(\d)x\d\.": r"depth_decoder.plane\1.",
    r"^normal_decoder\.reduc(\d)x\d\.": r"normal_decoder.normal\1.",
    r"\.reduc\.inter_\d+_(\d+)\.": r".reduction.to\1.",
    r"\.reduc\.(plane_params|final\.0)\.": ".reduction.out.",
    r"_decoder\.conv1\.": "_decoder.fuse.",
    r"_decoder\.get_depth\.0\.": "_decoder.head.",
    r"_decoder\.conv1_([xyz])\.": r"_decoder.fuse.\1.",
    r"_decoder\.get_normal_([xyz])\.0\.": r"_decoder.head.\1.",
}
ATTENTION: Rules = {
    r"\.([cs]a)1\.": r".attend8.\1.",
    r"\.([cs]a)2\.": r".attend_skip4.\1.",
    r"\.([cs]a)3\.": r".attend4.\1.",
    r"\.([cs]a)4\.": r".attend_skip2.\1.",
    r"\.([cs]a)5\.": r".attend2.\1.",
    r"\.ca\.fc\.": ".channel.mlp.",
    r"\.sa\.conv1\.": ".spatial.conv.",
}
CLASSIFIER = r"^encoder\.base_model\.fc\."
CROSS_HEADS = r"_d2n\.|_n2d\."
"""Heads that the program makes for its cross-task loss but does not use."""
UNUSED = rf"{CLASSIFIER}|\.n[123]_conv\.|\.conv1_concat\.|{CROSS_HEADS}"
COL3D: Rules = ENCODER | TRUNK | DECODERS | ATTENTION


def _sizes(tensors: Mapping[str, Tensor]) -> dict[str, Any]:
    """Encoder and width F, from the shapes of tensors."""
    return {
        "encoder": resnet_name(tensors, r"^encoder\.base_model\."),
        "width": channels_of(tensors, r"\.upconv5\.conv\.weight$"),
    }


def _published(tensors: Mapping[str, Tensor]) -> dict[str, Any]:
    return _sizes(tensors) | {"heads": "published"}


def _drop_unused_distances(tensors: dict[str, Tensor]) -> list[str]:
    # The authors' UNC blocks reduce to three channels, as LPG does, and never read the third: a distance.
    dropped = [n for n in tensors if re.search(r"^normal_decoder\.normal\d\.reduction\.out\.", n)]
    for name in dropped:
        tensors[name] = tensors[name][:2] if tensors[name].ndim > 0 else tensors[name]
    return dropped


BTS_WEIGHTS = Source(
    BTS, BTS_DECODER | ENCODER | TRUNK | DECODERS, CLASSIFIER, r"^decoder\.reduc8x8\.", None, _sizes
)
BTS_CBAM_WEIGHTS = Source(
    BTSCBAM, COL3D, rf"^normal_decoder\.|{UNUSED}", r"^depth_decoder\.ca1\.", CROSS_HEADS, _published
)
"""The program has an unused decoder of normals here, too: the names are those of BTS-CBAM-MTL."""
BTS_CBAM_MTL_WEIGHTS = Source(
    Col3DMTL, COL3D, UNUSED, r"^depth_decoder\.ca1\.", CROSS_HEADS, _published, _drop_unused_distances
)
COL3D_MTL_WEIGHTS = Source(Col3DMTL, COL3D, UNUSED, CROSS_HEADS, None, _published, _drop_unused_distances)
