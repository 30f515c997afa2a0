"""Recognise the ResNet that a set of tensors belongs to."""

import re
from collections.abc import Mapping

from torch import Tensor

RESNETS = {
    (2, 2, 2, 2, False): "resnet18",
    (3, 4, 6, 3, False): "resnet34",
    (3, 4, 6, 3, True): "resnet50",
    (3, 4, 23, 3, True): "resnet101",
    (3, 8, 36, 3, True): "resnet152",
}
"""Blocks of the four stages, and whether they are bottlenecks -> timm's name."""


def resnet_name(tensors: Mapping[str, Tensor], prefix: str) -> str:
    """Timm's name of the ResNet whose tensors follow a prefix, as `<prefix>layer1.0.conv1.weight`.

    Args:
        tensors: names to tensors.
        prefix: regular expression of what comes before torchvision's names.

    Raises:
        ValueError: there is no such ResNet among them.
    """
    inner = [re.sub(prefix, "", name) for name in tensors if re.search(prefix, name)]
    stage_blocks = {
        (match[1], match[2]) for name in inner if (match := re.match(r"layer(\d)\.(\d+)\.conv", name))
    }
    blocks = [len({block for stage, block in stage_blocks if stage == str(s)}) for s in (1, 2, 3, 4)]
    key = (blocks[0], blocks[1], blocks[2], blocks[3], "layer1.0.conv3.weight" in inner)
    if key not in RESNETS:
        raise ValueError(
            f"state_dict: the encoder must be one of {', '.join(RESNETS.values())}; "
            f"its stages have {', '.join(map(str, blocks))} blocks"
        )
    return RESNETS[key]
