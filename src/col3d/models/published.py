"""Weights that the authors' programs saved, loaded into the networks of this package."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from torch import Tensor

from col3d.checks import check_known
from col3d.layers.network import ImageNetwork
from col3d.models.bts import BTS
from col3d.models.bts_cbam import BTSCBAM
from col3d.models.col3d_mtl import Col3DMTL

Rules = dict[str, str]
"""Patterns over a name, in order, and what replaces them."""

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
UNUSED = rf"{CLASSIFIER}|\.n[123]_conv\.|\.conv1_concat\.|_d2n\.|_n2d\."


@dataclass(frozen=True)
class Source:
    """One published program: its network, how its names turn to ours, which tensors act on nothing."""

    network: Callable[..., ImageNetwork]
    rules: Rules
    unused: str
    options: dict[str, str] = field(default_factory=lambda: {"heads": "published"})


COL3D: Rules = ENCODER | TRUNK | DECODERS | ATTENTION
SOURCES = {
    "bts": Source(BTS, BTS_DECODER | ENCODER | TRUNK | DECODERS, CLASSIFIER, options={}),
    "col3d_bts_cbam": Source(BTSCBAM, COL3D, rf"^normal_decoder\.|{UNUSED}"),
    "col3d_mtl_no_xtc": Source(Col3DMTL, COL3D, UNUSED),
    "col3d_mtl": Source(Col3DMTL, COL3D, UNUSED),
}


def load_published(
    source: str,
    state_dict: Mapping[str, Any],
    encoder: str = "resnet50",
    max_depth: float = 100.0,
    width: int = 512,
) -> ImageNetwork:
    """A network with the authors' weights, in evaluation mode; its prediction is in house units.

    Args:
        source: the program that saved the weights, one of `SOURCES`.
        state_dict: names to tensors, bare or under "model" or "state_dict", with or without "module."
            before each name. Integer tensors may be missing.
        encoder: the encoder it was trained with, by timm's name.
        max_depth: the maximum depth it was trained with, in mm.
        width: F; 512 is published.

    Returns:
        The network. `skipped_names` lists the tensors on which no output depends, and which were left out.

    Raises:
        ValueError: the source is unknown, or the weights are not all of that network's or more than those.
    """
    known = SOURCES[check_known("source", source, SOURCES)]
    tensors = _tensors(state_dict)
    network = known.network(encoder=encoder, max_depth=max_depth, width=width, **known.options)
    skipped = [name for name in tensors if re.search(known.unused, name)]
    published = {house_name(name, known.rules): name for name in tensors if name not in skipped}
    fitted = {house: tensors[name] for house, name in published.items()}
    skipped += [f"{published[name]}[2]" for name in _drop_unused_distances(fitted)]
    _check_same(fitted, network.state_dict(), published)
    network.load_state_dict(fitted, strict=False)
    network.skipped_names = tuple(skipped)
    return network.eval()


def house_name(name: str, rules: Rules) -> str:
    """A published name in this package's terms.

    >>> house_name("normal_decoder.reduc8x8_normal.reduc.inter_64_32.0.weight", DECODERS)
    'normal_decoder.normal8.reduction.to32.0.weight'
    """
    for pattern, replacement in rules.items():
        name = re.sub(pattern, replacement, name)
    return name


def _tensors(state_dict: Mapping[str, Any]) -> dict[str, Tensor]:
    for wrapper in ("model", "state_dict"):
        if isinstance(state_dict.get(wrapper), Mapping):
            state_dict = state_dict[wrapper]
    if not state_dict or not all(isinstance(value, Tensor) for value in state_dict.values()):
        raise ValueError(
            "state_dict: must map names to tensors, itself or under 'model' or 'state_dict'; "
            f"it has {_some(list(state_dict)) or 'nothing'}"
        )
    return {name.removeprefix("module."): value for name, value in state_dict.items()}


def _drop_unused_distances(tensors: dict[str, Tensor]) -> list[str]:
    # The authors' UNC blocks reduce to three channels, as LPG does, and never read the third: a distance.
    dropped = [n for n in tensors if re.search(r"^normal_decoder\.normal\d\.reduction\.out\.", n)]
    for name in dropped:
        tensors[name] = tensors[name][:2]
    return dropped


def _check_same(given: dict[str, Tensor], wanted: dict[str, Tensor], published: dict[str, str]) -> None:
    missing = [n for n in wanted if n not in given and wanted[n].is_floating_point()]
    foreign = [published[n] for n in given if n not in wanted]
    misfits = [
        f"{published[n]} {tuple(given[n].shape)} for {tuple(wanted[n].shape)}"
        for n in given
        if n in wanted and given[n].shape != wanted[n].shape
    ]
    for rule, names in (("has unknown", foreign), ("lacks", missing), ("has other shapes:", misfits)):
        if names:
            raise ValueError(f"state_dict: {rule} {_some(names)}")


def _some(names: list[str], most: int = 5) -> str:
    return ", ".join(map(str, names[:most])) + (f" and {len(names) - most} more" if len(names) > most else "")
