"""Build a network from its checked options."""

from inspect import signature

from torch import nn

from col3d.errors import OptionError, UserError
from col3d.layers.freeze import freeze, thaw
from col3d.models import create
from col3d.models.options import ModelOptions
from col3d.registry import MODELS


def build_network(options: ModelOptions, size_hw: tuple[int, int]) -> nn.Module:
    """Build the network with its initial weights, and freeze its frozen parts.

    Raises:
        UserError: the encoder or its weights are not available, or parts do not fit. Other errors of the
            network's own code are not caught.
    """
    given = options.model_dump(exclude={"freeze", "unfreeze_at"})
    if "size_hw" in signature(MODELS[options.name].build).parameters:
        given["size_hw"] = size_hw
    try:
        built = create(**given)
        freeze(built, options.freeze)
        if options.unfreeze_at is not None:
            thaw(built, options.freeze)
    except OptionError as error:
        raise UserError(str(error)) from None
    return built
