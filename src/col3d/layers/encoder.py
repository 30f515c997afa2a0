"""Encoder: any timm model that offers five scales, behind one interface."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor, nn

from col3d.errors import OptionError
from col3d.layers.weight_file import check_archive, check_finite, check_fractions
from col3d.nearest_names import nearest_name

SCALES = (2, 4, 8, 16, 32)
PROBE_HW = (64, 96)
"""Size of the image that an encoder is tested with."""


class Encoder(nn.Module):
    """Feature maps at 1/2, 1/4, 1/8, 1/16 and 1/32 of the image.

    For ResNets these are the first ReLU and the four stages.

    Args:
        name: a timm model; a tag chooses its weights, as in `resnet50.tv_in1k`.
        pretrained: None for random weights, "imagenet" to fetch timm's, or the path of a local weight file.

    Attributes:
        channels: channels of the five maps, the largest map first.

    Raises:
        ValueError: the model is unknown or lacks a scale, or its weights are not available.
    """

    def __init__(self, name: str, pretrained: str | None = None) -> None:
        super().__init__()
        self.net = _create(name, fetch=pretrained == "imagenet")
        info: Any = self.net.feature_info
        self.indices = _five_scales(name, info.reduction())
        self.channels = [info.channels()[i] for i in self.indices]
        self._probe(name)
        if pretrained not in (None, "none", "imagenet"):
            load_encoder_weights(self.net, Path(str(pretrained)))

    @torch.no_grad()
    def _probe(self, name: str) -> None:
        """Refuse a model that takes only one size, or whose maps differ from its description."""
        image = torch.zeros(1, 3, *PROBE_HW, device=next(self.net.parameters()).device)
        try:
            shapes = [tuple(x.shape[1:]) for x in self.net.eval()(image)]
        except Exception as error:
            raise ValueError(
                _no_scales(name, f"an image of 64 x 96 stops it: {error}".splitlines()[0])
            ) from None
        finally:
            self.net.train()
        wanted = [(c, PROBE_HW[0] // s, PROBE_HW[1] // s) for c, s in zip(self.channels, SCALES, strict=True)]
        if [shapes[i] for i in self.indices] != wanted:
            sizes = ", ".join(f"{h} x {w}" for _, h, w in shapes)
            raise OptionError(_no_scales(name, f"for an image of 64 x 96 it has maps of {sizes}"))

    def forward(self, image: Float[Tensor, "b 3 h w"]) -> list[Float[Tensor, "b _ _ _"]]:
        """A normalised image whose sides are multiples of 32 -> five maps, the largest first."""
        maps = self.net(image)
        return [maps[i] for i in self.indices]


def _create(name: str, fetch: bool) -> nn.Module:
    import timm

    if not timm.is_model(name):
        raise OptionError(
            f"model.encoder: timm has no model {name!r}{nearest_name(name, timm.list_models())}"
        )
    try:
        return timm.create_model(name, features_only=True, pretrained=fetch)
    except Exception as error:
        if "pretrained tag" in str(error):
            raise OptionError(f"model.encoder: {name!r}: {error}".splitlines()[0]) from None
        if not fetch:
            raise OptionError(_no_scales(name, f"timm says: {error}".splitlines()[0])) from error
        raise OptionError(
            f"model.pretrained: no ImageNet weights for {name!r} could be fetched ({type(error).__name__}); "
            "say model.pretrained=none for random weights or model.pretrained=<path of a weight file>"
        ) from error


def _five_scales(name: str, reductions: list[int]) -> list[int]:
    if not set(SCALES) <= set(reductions):
        raise OptionError(_no_scales(name, "it has " + ", ".join(f"/{r}" for r in reductions)))
    return [reductions.index(scale) for scale in SCALES]


def _no_scales(name: str, reason: str) -> str:
    return f"model.encoder: {name!r} must offer maps at /2, /4, /8, /16 and /32 (ResNets do), but {reason}"


def load_encoder_weights(net: nn.Module, path: Path) -> None:
    """Fill an encoder from a weight file of timm or torchvision; the classifier's weights are left out.

    Args:
        net: the encoder; filled in place.
        path: a file of `torch.save` or safetensors, bare or under "state_dict" or "model".

    Raises:
        ValueError: there is no such file, or weights are missing from it.
    """
    # timm joins the first levels of some names with "_" when it turns a classifier into an encoder.
    read = read_encoder_weights(path)
    plain = {name.replace(".", "_"): value for name, value in read.items()}
    given = {
        name: plain[name.replace(".", "_")] for name in net.state_dict() if name.replace(".", "_") in plain
    }
    stored = [name for name in read if name.replace(".", "_") not in {n.replace(".", "_") for n in given}]
    fill_encoder(net, net.state_dict(), given, repr(str(path)))
    refuse_more_blocks(list(given), stored, repr(str(path)))


def refuse_more_blocks(used: Sequence[str], unused: Sequence[str], source: str) -> None:
    """Refuse weights of a larger model of the same family, whose stages have more blocks.

    Raises:
        ValueError: names the first such weight.
    """

    def blocks(name: str) -> list[tuple[str, str]]:
        parts = name.split(".")
        return [
            (".".join(parts[:i]), ".".join(parts[: i + 1]))
            for i in range(1, len(parts))
            if parts[i].isdigit()
        ]

    lists = {stage for name in used for stage, _ in blocks(name)}
    known = {block for name in used for _, block in blocks(name)}
    for name in unused:
        if any(stage in lists and block not in known for stage, block in blocks(name)):
            raise OptionError(
                f"model.pretrained: {source} is of a larger model: {name!r} has no place in this one"
            )


def read_encoder_weights(path: Path) -> Mapping[Any, Any]:
    """Read names and tensors from a weight file.

    Raises:
        ValueError: there is no such file, or it cannot be read as weights.
    """
    from timm.models import load_state_dict

    if not path.is_file():
        raise OptionError(
            f"model.pretrained: must be none, imagenet or a weight file; there is no file {str(path)!r}"
        )
    try:
        check_archive(path)
    except ValueError as error:
        raise OptionError(f"model.pretrained: {error}") from None
    try:
        weights: Mapping[Any, Any] = load_state_dict(str(path), weights_only=True)
    except Exception as error:
        raise OptionError(
            f"model.pretrained: {str(path)!r} cannot be read as weights ({type(error).__name__})"
        ) from error
    if any(str(name).startswith("network.") for name in weights):
        raise OptionError(
            f"model.pretrained: {path} is a checkpoint of train.py, not weights of an encoder; begin from it "
            "with init.checkpoint"
        )
    return weights


def fill_encoder(net: nn.Module, wanted: Mapping[str, Tensor], given: Mapping[str, Any], source: str) -> None:
    """Load the wanted weights from the given ones.

    Raises:
        ValueError: weights are missing or have other shapes; names the source.
    """
    missing = [n for n in wanted if n not in given and wanted[n].is_floating_point()]
    if missing:
        raise OptionError(f"model.pretrained: {source} lacks {len(missing)} weights, such as {missing[0]!r}")
    chosen = {name: given[name] for name in wanted if name in given}
    misfits = [n for n in chosen if getattr(chosen[n], "shape", None) != wanted[n].shape]
    if misfits:
        raise OptionError(
            f"model.pretrained: {source} does not fit in {len(misfits)} weights, such as {misfits[0]!r}"
        )
    try:
        check_finite(chosen)
        check_fractions(chosen, wanted)
    except ValueError as error:
        raise OptionError(f"model.pretrained: {source}: {error}") from None
    net.load_state_dict(chosen, strict=False)
