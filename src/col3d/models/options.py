"""Options that networks share, and their values in presets."""

import json
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, PlainValidator, SerializeAsAny
from pydantic_core import PydanticUndefined

from col3d.errors import OptionError
from col3d.registry import MODELS, Part
from col3d.registry.annotations import plain
from col3d.registry.schema import NoneWord, Options

MaxDepth = Annotated[float, Field(gt=0)]
"""Upper bound of the depth in mm."""
Width = Annotated[int, Field(ge=64, multiple_of=64)]
"""F, which the sizes of decoders scale from; 512 is published."""

SMALLER: Mapping[str, Mapping[str, Any]] = {"laptop": {"width": 128}, "smoke": {"width": 64}}
"""Presets of networks of which only the width is reduced."""


def with_encoder(small: str) -> dict[str, dict[str, Any]]:
    """Presets of networks on an encoder: ImageNet's weights for the paper's, a small one for others."""
    smaller = {preset: {"encoder": small, **options} for preset, options in SMALLER.items()}
    return {"paper": {"pretrained": "imagenet"}, **smaller}


class ModelOptions(Options):
    """What every network can be told; its own options, the parameters of its class, join these."""

    name: str
    max_depth: MaxDepth = 100.0
    normals: Literal["none", "unc"] = "none"
    normal_frame: Literal["camera", "ray"] = "camera"
    freeze: list[Literal["first_conv", "batch_norm", "batch_norm_statistics", "encoder"]] = Field(
        default_factory=list
    )
    unfreeze_at: Annotated[Annotated[int, Field(ge=1)] | None, NoneWord] = None
    """The epoch, the first being 0, from which an encoder that is kept learns, too."""


def untrained(options: ModelOptions) -> ModelOptions:
    """Options of the same network with random weights, which a checkpoint is about to fill."""
    before = getattr(options, "pretrained", None)
    nothing = False if isinstance(before, bool) else None
    return options.model_copy(update={"pretrained": nothing}) if before else options


def file_of_weights(options: ModelOptions) -> str | None:
    """Value of `model.pretrained`, where a network has that option and it is a text; else None."""
    given = getattr(options, "pretrained", None)
    return given if isinstance(given, str) else None


def model_options(given: Any) -> ModelOptions:
    """Options of a registered network, checked against its signature.

    Raises:
        ValueError: nothing has that name, or options do not fit one another; pydantic's for single options.
    """
    if isinstance(given, ModelOptions):
        return given
    if not isinstance(given, Mapping) or "name" not in given:
        raise OptionError(f"model.name: a value is needed, got {given!r}")
    part = MODELS[str(given["name"])]
    options = part.options(ModelOptions).model_validate(given)
    assert isinstance(options, ModelOptions)
    own = part.facts["predicts"]
    if options.normals == "none" and "normals" in own:
        raise OptionError(f"model.normals: {options.name} always predicts normals{instead(part)}")
    if options.normals == "none" and options.normal_frame == "ray":
        raise OptionError("model.normal_frame: ray is for predicted normals, and model.normals is none")
    if options.unfreeze_at is not None and "encoder" not in options.freeze:
        raise OptionError("model.unfreeze_at: is of model.freeze=[encoder], and nothing of that is kept")
    return options


def instead(part: Part) -> str:
    """A hint at the network that predicts depth alone; empty where the registration names none."""
    name = part.facts["depth_alone"]
    return f"; take {name} for depth alone" if name else ""


def node(part: Part) -> dict[str, Any]:
    """Configuration node of `model=NAME`: every option with its default."""
    presets: Mapping[str, Mapping[str, Any]] = part.facts["presets"]
    values: dict[str, Any] = {"max_depth": 100.0}
    for option, (_, default) in part.parameters().items():
        usual = "???" if default is PydanticUndefined else plain(default)
        special = {name: given[option] for name, given in presets.items() if option in given}
        values[option] = by_preset(special, usual) if special else usual
    normals = "unc" if "normals" in part.facts["predicts"] else "none"
    return {
        "name": part.name,
        **values,
        "normals": normals,
        "normal_frame": "camera",
        "freeze": [],
        "unfreeze_at": None,
    }


def by_preset(special: Mapping[str, Any], usual: Any) -> str:
    """A value that depends on the preset, as the configuration's resolver `by_preset` computes it."""
    entries = ",".join(f"{name}:{_word(value)}" for name, value in special.items())
    return f"${{by_preset:{{{entries}}},{_word(usual)}}}"


def _word(value: Any) -> str:
    return "none" if value is None else json.dumps(value) if isinstance(value, str | list) else str(value)


Model = Annotated[SerializeAsAny[ModelOptions], PlainValidator(model_options)]
"""Options of a registered network; its name decides which options there are."""
