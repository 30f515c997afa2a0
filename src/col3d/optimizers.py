"""Optimisers by name: those of `torch.optim`, and anybody's own."""

from typing import Annotated, Any

import torch.optim
from pydantic import Field
from torch import nn
from torch.optim import Optimizer

from col3d.checks import OptionError
from col3d.optimisation import OptimizerFactory, parameter_groups
from col3d.registry import OPTIMIZERS, Part, register_optimizer
from col3d.schema import NoneWord, Options, plain

UNFIT = (torch.optim.Optimizer, torch.optim.LBFGS, torch.optim.SparseAdam, torch.optim.Muon)
"""A base, and those that need a closure, sparse gradients or matrices alone."""
OURS: dict[str, dict[str, Any]] = {
    "adam": {"lr": 1e-4},
    "adamw": {"lr": 1e-4},
    "sgd": {"lr": 1e-3, "momentum": 0.9},
}
"""Defaults here that are not those of torch."""


class OptimizerOptions(Options):
    """What every optimiser can be told; the parameters of its class join these."""

    name: str
    lr: Annotated[float, Field(gt=0)] = 1e-3
    decoder_weight_decay: Annotated[Annotated[float, Field(ge=0)] | None, NoneWord] = None


def optimizer_options(given: Any) -> OptimizerOptions:
    """Options of a registered optimiser, checked against its signature.

    Raises:
        ValueError: nothing has that name; pydantic's for single options.
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
    """Let a library say what its rules are, on one layer; a user's own code keeps its traceback."""
    part = OPTIMIZERS[options.name]
    try:
        optimizer_of(options)(nn.Linear(1, 1))
    except (ValueError, RuntimeError) as error:
        if part.package not in ("torch", "timm"):
            raise
        raise OptionError(f"optimizer: {options.name}: {error}") from None


def optimizer_of(options: OptimizerOptions) -> OptimizerFactory:
    """Network -> optimiser of the parameters that learn."""
    part = OPTIMIZERS[options.name]
    given = {"lr": options.lr, **{name: getattr(options, name) for name in part.parameters()}}
    decay = given.pop("weight_decay", None)

    def build(network: nn.Module) -> Optimizer:
        groups = parameter_groups(network, decay or 0.0, options.decoder_weight_decay)
        if decay is None:
            groups = [{"params": group["params"]} for group in groups]
        built: Optimizer = part.build(groups, **given)
        return built

    return build


def node(part: Part) -> dict[str, Any]:
    """What `optimizer=NAME` brings into a configuration: every option with its default."""
    usual = {name: plain(default) for name, (_, default) in part.parameters().items()}
    ours = {"lr": usual.get("lr") or 1e-3, **part.facts["defaults"]}
    return {"name": part.name, **usual, **ours, "decoder_weight_decay": "none"}


for _name, _kind in vars(torch.optim).items():
    if isinstance(_kind, type) and issubclass(_kind, Optimizer) and _kind not in UNFIT:
        register_optimizer(_name.lower(), _kind, defaults=OURS.get(_name.lower(), {}))
