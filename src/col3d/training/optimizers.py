"""Optimisers by name: registration of those in `torch.optim`, and their options."""

from typing import Annotated, Any

import torch.optim
from pydantic import Field
from torch import nn
from torch.optim import Optimizer

from col3d.errors import OptionError
from col3d.registry import OPTIMIZERS, Part, register_optimizer
from col3d.registry.schema import NoneWord, Options, defaults
from col3d.training.parameter_groups import OptimizerFactory, layers_of, parameter_groups, scaled_groups

UNFIT = (torch.optim.Optimizer, torch.optim.LBFGS, torch.optim.SparseAdam, torch.optim.Muon)
"""Not registered: the base class, and optimisers that need a closure, sparse gradients or only matrices."""
OURS: dict[str, dict[str, Any]] = {
    "adam": {"lr": 1e-4},
    "adamw": {"lr": 1e-4},
    "sgd": {"lr": 1e-3, "momentum": 0.9},
}
"""Defaults that differ from those of torch."""
OF_ENCODERS = ("decoder_weight_decay", "encoder_lr", "layer_decay")
"""Options that treat the encoder and the rest of a network differently."""


class OptimizerOptions(Options):
    """What every optimiser can be told; the parameters of its class join these."""

    name: str
    lr: Annotated[float, Field(gt=0)] = 1e-3
    decoder_weight_decay: Annotated[Annotated[float, Field(ge=0)] | None, NoneWord] = None
    encoder_lr: Annotated[Annotated[float, Field(gt=0)] | None, NoneWord] = None
    layer_decay: Annotated[Annotated[float, Field(gt=0, le=1)] | None, NoneWord] = None


def optimizer_options(given: Any) -> OptimizerOptions:
    """Validate the options of a registered optimiser against its signature.

    Raises:
        ValueError: no optimiser has that name; pydantic's errors for single options.
    """
    if isinstance(given, OptimizerOptions):
        return given
    name = str(given.get("name")) if isinstance(given, dict) else str(given)
    options = OPTIMIZERS[name].options(OptimizerOptions).model_validate(given)
    assert isinstance(options, OptimizerOptions)
    if options.decoder_weight_decay is not None and not hasattr(options, "weight_decay"):
        raise OptionError(f"optimizer.decoder_weight_decay: {options.name} has no weight decay")
    _try(options)
    return options


def _try(options: OptimizerOptions) -> None:
    """Build the optimiser of one layer, to report violations of a library's rules.

    A user's own code keeps its traceback.
    """
    part = OPTIMIZERS[options.name]
    try:
        sample_optimizer(options)
    except (ValueError, RuntimeError) as error:
        if part.package not in ("torch", "timm"):
            raise
        raise OptionError(f"optimizer: {options.name}: {error}") from None


def sample_optimizer(options: OptimizerOptions) -> Optimizer:
    """Build the optimiser for one layer."""
    return optimizer_of(options)(nn.Linear(1, 1))


def check_encoder(options: OptimizerOptions, network: nn.Module) -> None:
    """Refuse learning rates for an encoder that a network does not have.

    Raises:
        OptionError: names the option.
    """
    encoder = getattr(network, "encoder", None)
    for option in ("encoder_lr", "layer_decay"):
        if getattr(options, option) is not None and not isinstance(encoder, nn.Module):
            raise OptionError(
                f"optimizer.{option}: {type(network).__name__} has no module `encoder` to have a rate"
            )
    if options.layer_decay is not None and len(layers_of(encoder, 0.5)) < 2:  # type: ignore[arg-type]
        raise OptionError("optimizer.layer_decay: finds fewer than two layers that learn in the encoder")


def optimizer_of(options: OptimizerOptions) -> OptimizerFactory:
    """Return a function from a network to the optimiser of its trainable parameters."""
    part = OPTIMIZERS[options.name]
    given = {"lr": options.lr, **part.own(options)}
    decay = given.pop("weight_decay", None)

    def build(network: nn.Module) -> Optimizer:
        groups = _groups(network, options, decay or 0.0)
        if decay is None:
            groups = [{key: group[key] for key in group if key != "weight_decay"} for group in groups]
        built: Optimizer = part.made(part.build(groups, **given), "param_groups")
        return built

    return build


def _groups(network: nn.Module, options: OptimizerOptions, decay: float) -> list[dict[str, Any]]:
    rest = options.decoder_weight_decay
    if options.encoder_lr is None and options.layer_decay is None:
        return parameter_groups(network, decay, rest)
    decays = (decay, decay if rest is None else rest)
    return scaled_groups(network, options.lr, decays, options.encoder_lr, options.layer_decay)


def node(part: Part) -> dict[str, Any]:
    """Return what `optimizer=NAME` adds to a configuration: every option with its default."""
    usual = defaults(part.parameters())
    ours = {"lr": usual.get("lr") or 1e-3, **part.facts["defaults"]}
    return {"name": part.name, **usual, **ours, **dict.fromkeys(OF_ENCODERS, "none")}


for _name, _kind in vars(torch.optim).items():
    if isinstance(_kind, type) and issubclass(_kind, Optimizer) and _kind not in UNFIT:
        register_optimizer(_name.lower(), _kind, defaults=OURS.get(_name.lower(), {}))
