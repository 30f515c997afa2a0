"""Map names of NeWCRFs's published tensors to this package's.

The authors' program sets mmcv's group norm of 256 groups on all four pooled maps (it replaces the setting at
the first one, and the others inherit it), and mmcv names such norms `gn`. Where they are named `bn` and come
with running statistics, the program ran with another ConvModule than mmcv's, whose norms are batch
norms: another function, but the one that those weights belong to. So the names decide.
"""

import re
from collections.abc import Mapping
from typing import Any

from torch import Tensor

from col3d.layers.swin import SIZES
from col3d.models.newcrfs import NeWCRFs
from col3d.models.published.source import Rules, Source, channels_of

RULES: Rules = {
    r"^backbone\.": "encoder.",
    r"^encoder\.norm(\d)\.": r"encoder.norms.\1.",
    r"^encoder\.layers\.2\.downsample\.": "encoder.layers.3.downsample.",
    r"^encoder\.layers\.1\.downsample\.": "encoder.layers.2.downsample.",
    r"^encoder\.layers\.0\.downsample\.": "encoder.layers.1.downsample.",
    r"^crf3\.": "crf32.",
    r"^crf2\.": "crf16.",
    r"^crf1\.": "crf8.",
    r"^crf0\.": "crf4.",
    r"\.proj_x\.": ".to_x.",
    r"\.proj_v\.": ".to_value.",
    r"\.crf_layer\.": ".",
    r"\.attn\.qk\.": ".attn.qkv.",
    r"\.norm_crf\.": ".norm.",
    r"^decoder\.psp_modules\.(\d)\.1\.": r"pyramid.pooled.\1.",
    r"^decoder\.bottleneck\.": "pyramid.fuse.",
    r"^(pyramid\..*)\.[bg]n\.": r"\1.norm.",
    r"^disp_head1\.conv1\.": "head.",
}
UNUSED = r"\.relative_position_index$"
MARK = r"^crf3\."


def options(tensors: Mapping[str, Tensor]) -> dict[str, Any]:
    """Options to build `NeWCRFs` with: encoder, width and the pyramid's norm.

    Raises:
        ValueError: the encoder is no Swin that is known.
    """
    stage_blocks = [
        {
            match[1]
            for name in tensors
            if (match := re.match(rf"backbone\.layers\.{stage}\.blocks\.(\d+)\.", name))
        }
        for stage in range(4)
    ]
    size = (channels_of(tensors, r"^backbone\.patch_embed\.proj\.weight$"), tuple(map(len, stage_blocks)))
    return {
        "encoder": _swin_name(*size),
        "width": channels_of(tensors, r"^decoder\.bottleneck\.conv\.weight$"),
        "pyramid_norm": "batch"
        if any("psp" in n and n.endswith(".running_var") for n in tensors)
        else "group",
    }


def _swin_name(channels: int, depths: tuple[int, ...]) -> str:
    for name, size in SIZES.items():
        if size == (channels, depths):
            return name
    raise ValueError(
        f"state_dict: the encoder must be one of {', '.join(SIZES)}; it has {channels} channels at 1/4 "
        f"and {', '.join(map(str, depths))} blocks"
    )


NEWCRFS_WEIGHTS = Source(NeWCRFs, RULES, UNUSED, MARK, None, options)
