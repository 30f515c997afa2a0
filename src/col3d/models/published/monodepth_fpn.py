"""Map names of the public MonoDepth-FPN's tensors to this package's."""

from collections.abc import Mapping
from typing import Any

from torch import Tensor

from col3d.models.monodepth_fpn import MonoDepthFPN
from col3d.models.published.resnets import resnet_name
from col3d.models.published.source import Rules, Source, channels_of, our_name

RULES: Rules = {
    r"^layer0\.0\.": "encoder.net.conv1.",
    r"^layer0\.1\.": "encoder.net.bn1.",
    r"^layer([1-4])\.0\.": r"encoder.net.layer\1.",
    r"^toplayer\.": "pyramid.lateral.at32.",
    r"^latlayer1\.": "pyramid.lateral.at16.",
    r"^latlayer2\.": "pyramid.lateral.at8.",
    r"^latlayer3\.": "pyramid.lateral.at4.",
    r"^smooth1\.": "pyramid.smooth.at16.",
    r"^smooth2\.": "pyramid.smooth.at8.",
    r"^smooth3\.": "pyramid.smooth.at4.",
    r"^up([123])\.0\.": r"agg\1.4.",
    r"^agg1\.": "depth_decoder.refine.at32.",
    r"^agg2\.": "depth_decoder.refine.at16.",
    r"^agg3\.": "depth_decoder.refine.at8.",
    r"^agg4\.": "depth_decoder.refine.at4.",
    r"^predict1\.": "depth_decoder.fuse.",
    r"^predict2\.0\.": "depth_decoder.head.",
}
UNUSED = r"(?!)"  # matches no name: every layer of the program affects its depth
MARK = r"^latlayer1\."


def options(tensors: Mapping[str, Tensor]) -> dict[str, Any]:
    """Options to build `MonoDepthFPN` with: encoder, and width from the channels of the pyramid.

    Raises:
        ValueError: the encoder is no ResNet, or there is no pyramid.
    """
    renamed = {our_name(name, RULES): tensor for name, tensor in tensors.items()}
    return {
        "encoder": resnet_name(renamed, r"^encoder\.net\."),
        "width": 2 * channels_of(tensors, r"^smooth1\.weight$"),
    }


MONODEPTH_FPN_WEIGHTS = Source(MonoDepthFPN, RULES, UNUSED, MARK, None, options, normalised=False)
