"""Learning-rate schedules by name: our own, those of `torch.optim.lr_scheduler`, and their options."""

import functools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from inspect import signature
from typing import Annotated, Any, Literal

import torch.optim.lr_scheduler
from pydantic import Field, PositiveInt, create_model
from torch.optim import Optimizer
from torch.optim.lr_scheduler import LambdaLR, LRScheduler, ReduceLROnPlateau

from col3d.errors import OptionError
from col3d.registry import COUNTS, SCHEDULERS, Part, register_scheduler
from col3d.registry.schema import NoneWord, Options, check_names, defaults

UNFIT = ("LRScheduler", "_LRScheduler", "LambdaLR", "MultiplicativeLR", "SequentialLR", "ChainedScheduler")
"""Not registered: base classes, and schedules that are made of functions or of other schedules."""
EACH_STEP = ("OneCycleLR", "CyclicLR")
"""Schedules of torch that count steps; all others count epochs."""
RATES = ("max_lr", "base_lr")
"""Parameters with rates that a schedule sets, regardless of those of the parameter groups."""
Interval = Annotated[Literal["step", "epoch"] | None, NoneWord]


SchedulerFactory = Callable[[Optimizer, int, int], LRScheduler | None]
"""(optimiser, steps of the schedule over the training, epochs) -> schedule; None for a constant rate."""


@dataclass(frozen=True)
class TrainingLength:
    """Length of a training.

    Attributes:
        steps: number of steps of the schedule over the whole training: steps of the optimiser, or epochs if
            it is stepped after epochs.
        epochs: number of epochs of the training.
    """

    steps: int
    epochs: int


class SchedulerOptions(Options):
    """What every schedule can be told; the parameters of its class join these.

    `interval` is what it is stepped after, "step" or "epoch"; as the schedule is registered when null.
    """

    name: str
    interval: Interval = None


class PlateauOptions(SchedulerOptions):
    """Those of schedules that watch a metric."""

    monitor: str = "val/abs_rel"


@register_scheduler("constant", interval="step")
def constant(optimizer: Optimizer) -> None:
    """One learning rate throughout."""


@register_scheduler("polynomial", interval="step")
def polynomial(
    optimizer: Optimizer,
    training: TrainingLength,
    power: Annotated[float, Field(gt=0)] = 0.9,
    final_ratio: Annotated[float, Field(ge=0, le=1)] = 0.1,
    hold: Annotated[float, Field(ge=0, lt=1)] = 0.0,
) -> LRScheduler:
    """(1 - step / steps) ** power, down to a share of the start; `hold` is a share of the steps before.

    References:
        Lee et al.: From Big to Small: Multi-Scale Local Planar Guidance for Monocular Depth Estimation
        (BTS), 2019, section 4.2: power 0.9, down to a tenth.
    """
    held = hold * training.steps

    def ratio(step: int) -> float:
        gone = max(0.0, min(step, training.steps) - held) / max(training.steps - held, 1.0)
        remaining: float = (1 - gone) ** power
        return final_ratio + (1 - final_ratio) * remaining

    return LambdaLR(optimizer, ratio)


@register_scheduler("step", interval="step")
def step(
    optimizer: Optimizer,
    training: TrainingLength,
    epochs: Annotated[int, Field(gt=0)] = 6,
    factor: Annotated[float, Field(gt=0, le=1)] = 0.1,
) -> LRScheduler:
    """The learning rate times `factor` after every `epochs`."""
    period = epochs * training.steps // training.epochs
    return LambdaLR(optimizer, lambda step: factor ** (step // period))


def scheduler_options(given: Any) -> SchedulerOptions:
    """Validate the options of a registered schedule against its signature.

    Raises:
        ValueError: no schedule has that name; pydantic's errors for single options.
    """
    if isinstance(given, SchedulerOptions):
        return given
    if not isinstance(given, Mapping) or "name" not in given:
        raise OptionError(f"scheduler.name: a value is needed, got {given!r}")
    part = SCHEDULERS[str(given["name"])]
    kind = part.options(base_class(part))
    check_names("scheduler", given, kind)
    options = kind.model_validate(given)
    assert isinstance(options, SchedulerOptions)
    if isinstance(options, PlateauOptions) and options.interval == "step":
        raise OptionError(f"scheduler.interval: {options.name} is stepped after epochs, got step")
    return options


@functools.cache
def base_class(part: Part) -> type[SchedulerOptions]:
    """Return the base class of a schedule's options, with counts that default to the training's length."""
    watches = isinstance(part.build, type) and issubclass(part.build, ReduceLROnPlateau)
    base = PlateauOptions if watches else SchedulerOptions
    count = Annotated[PositiveInt | None, NoneWord]
    fields: dict[str, Any] = {
        name: (count, None) for name in COUNTS if name in signature(part.build).parameters
    }
    return create_model(base.__name__, __base__=base, **fields)


def interval_of(options: SchedulerOptions) -> str:
    """Return what a schedule is stepped after: "step" or "epoch"."""
    return options.interval or str(SCHEDULERS[options.name].facts["interval"])


def is_of_length(options: SchedulerOptions) -> bool:
    """Whether a schedule of torch takes its length from the training; it cannot be extended later."""
    return any(getattr(options, name, 0) is None for name in COUNTS)


def scheduler_of(options: SchedulerOptions) -> SchedulerFactory:
    """Return a function (optimiser, steps, epochs) -> schedule; missing counts are those of the training."""
    part = SCHEDULERS[options.name]
    takes = signature(part.build).parameters
    own = part.own(options)

    def build(optimizer: Optimizer, steps: int, epochs: int) -> LRScheduler | None:
        given = {**own, **_lengths(options, own, steps, epochs)}
        for name in {*RATES} & own.keys():
            given[name] = _by_group(own[name], optimizer)
        if "training" in takes:
            given["training"] = TrainingLength(steps, epochs)
        built: LRScheduler | None = part.build(optimizer, **given)
        return built

    return build


def _lengths(
    options: SchedulerOptions, own: Mapping[str, Any], steps: int, epochs: int
) -> dict[str, int | None]:
    """Return the counts of a schedule: as given, or else those of the training.

    If `epochs` or `steps_per_epoch` of torch's OneCycleLR is given, both replace `total_steps`.
    """
    counts = {name: getattr(options, name) for name in COUNTS if hasattr(options, name)}
    parts = {"epochs": epochs, "steps_per_epoch": math.ceil(steps / epochs)}
    partly = {name: own[name] or value for name, value in parts.items() if name in own}
    if counts.get("total_steps", 0) is None and len(partly) == len(parts) and any(own[n] for n in parts):
        return {**counts, **partly}
    return {name: steps if value is None else value for name, value in counts.items()}


def _by_group(rate: Any, optimizer: Optimizer) -> Any:
    """Scale a rate for each parameter group by the ratio of its rate to that of the optimiser."""
    scales = [group.get("lr_scale", 1.0) for group in optimizer.param_groups]
    if isinstance(rate, list | tuple) or all(scale == 1.0 for scale in scales):
        return rate
    return [rate * scale for scale in scales]


def try_schedule(options: SchedulerOptions, optimizer: Optimizer, epochs: int) -> None:
    """Build a schedule for an optimiser of the same kind, to report violations of torch's rules.

    Raises:
        OptionError: torch's message; a user's own code keeps its traceback.
    """
    try:
        scheduler_of(options)(optimizer, 100 * epochs, epochs)
    except (ValueError, TypeError) as error:
        if SCHEDULERS[options.name].package != "torch":
            raise
        raise OptionError(f"scheduler: {options.name}: {' '.join(str(error).split())}") from None


def node(part: Part) -> dict[str, Any]:
    """Return what `scheduler=NAME` adds to a configuration: every option with its default."""
    base = {name: field.default for name, field in base_class(part).model_fields.items() if name != "name"}
    return {"name": part.name, **defaults(part.parameters()), **base}


def _register_all() -> None:
    for name, kind in vars(torch.optim.lr_scheduler).items():
        if isinstance(kind, type) and issubclass(kind, LRScheduler) and name not in UNFIT:
            register_scheduler(name, kind, interval="step" if name in EACH_STEP else "epoch")


_register_all()
