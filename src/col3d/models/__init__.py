"""Networks, one paper a file: (image, rays) -> `Prediction`."""

from collections.abc import Mapping
from inspect import signature
from typing import Any

from torch import nn

from col3d.errors import OptionError
from col3d.layers.network import DepthNetwork, predicts
from col3d.layers.normal_decoder import NORMAL_FRAMES
from col3d.models import bts, bts_cbam, col3d_mtl, monodepth_fpn, newcrfs, pix2pix
from col3d.models.options import ModelOptions, instead
from col3d.nearest_names import check_known, nearest_name
from col3d.registry import MODELS, Part
from col3d.registry.refusals import checked

__all__ = ["bts", "bts_cbam", "col3d_mtl", "create", "monodepth_fpn", "newcrfs", "pix2pix"]

NORMALS = ("none", "unc")


def create(
    name: str, *, normals: str | None = None, normal_frame: str = "camera", **options: Any
) -> nn.Module:
    """Create a network by its registered name.

    `col3d.registry.available("model")` lists the names, `describe("model", name)` the options of one.

    Args:
        name: name of a registered network.
        normals: "unc" adds a decoder of normals, "none" does not; absent, the network's own default.
        normal_frame: frame of predicted normals: "camera", anywhere on the sphere; or "ray",
            always facing the camera, for which the network is called as `network(image, rays)`.
        options: keyword arguments of the network's own class, checked against its signature. An `encoder` or
            a `width` of None is the network's default.

    Raises:
        OptionError: the name or an option is unknown, or a value breaks a rule; one line for each.

    >>> create("bts", encoder="resnet18", width=64).tasks
    ('depth',)
    >>> create("bts", encoder="resnet18", width=64, normals="unc").tasks
    ('depth', 'normals')
    """
    part = MODELS[name]
    check_known("model.normal_frame", normal_frame, NORMAL_FRAMES)
    wanted = None if normals is None else check_known("model.normals", normals, NORMALS)
    if wanted == "none" and "normals" in part.facts["predicts"]:
        raise OptionError(f"model.normals: {name} always predicts normals{instead(part)}")
    given = _arguments(part, {**options, "normal_frame": normal_frame})
    network: nn.Module = part.made(part.build(**given), "forward")
    by_itself = "normals" in predicts(network, part.facts["predicts"])
    if wanted == "unc" and not by_itself:
        _add_normals(network, part, options.get("width") or 512, normal_frame)
    elif normal_frame == "ray" and not by_itself:
        raise OptionError("model.normal_frame: ray is for predicted normals; take normals=unc")
    if not hasattr(network, "tasks"):
        network.tasks = part.facts["predicts"]
    layout = getattr(network, "memory_format", None)
    return network if layout is None else network.to(memory_format=layout)


def _arguments(part: Part, given: Mapping[str, Any]) -> dict[str, Any]:
    """The given options that the class has as parameters, checked.

    Raises:
        OptionError: an unknown name, or a value that breaks a rule.
    """
    takes = signature(part.build).parameters
    shared_options = ModelOptions.model_fields.keys() - takes.keys()
    given = {option: value for option, value in given.items() if option not in shared_options}
    passes_on = any(parameter.kind is parameter.VAR_KEYWORD for parameter in takes.values())
    for option in given:
        if option not in takes and not passes_on:
            known = [f"model.{name}" for name in takes]
            hint = nearest_name(f"model.{option}", known)
            raise OptionError(f"model.{option}: {part.name} has no such option{hint}")
    absent = [name for name in ("encoder", "width") if name in given and given[name] is None]
    given = {option: value for option, value in given.items() if option not in absent}
    declared = {option: value for option, value in given.items() if option in part.parameters()}
    return {**given, **checked(part.options(), declared, "model")}


def _add_normals(network: nn.Module, part: Part, width: int, frame: str) -> None:
    if not isinstance(network, DepthNetwork):
        raise OptionError(
            f"model.normals: {part.name} offers no maps for a decoder of normals; derive it from "
            "col3d.layers.network.DepthNetwork, or let it predict normals itself"
        )
    network.add_normals(width, frame)
