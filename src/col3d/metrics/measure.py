"""Compute every registered metric of a task, calling each function once."""

from collections.abc import Callable, Mapping, Sequence
from inspect import signature
from types import MappingProxyType
from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn.functional import normalize

from col3d.errors import UserError
from col3d.registry import METRICS, Part
from col3d.registry.metric_specs import OURS, MetricSpec, by_name
from col3d.registry.schema import place_of

Options = Mapping[str, Mapping[str, Any]]
"""Options of metrics, by the metrics' names."""
NONE: Options = MappingProxyType({})
SMALLEST = 1e-3
"""Lower bound in mm that predicted depth is clipped to, so that its logarithm exists."""


def registered_specs(
    task: str | None = None, validation: bool = False, names: Sequence[str] | None = None
) -> dict[str, MetricSpec]:
    """Spec of each registered metric, by name: ours in the order of their columns, then others'.

    Args:
        task: "depth" or "normals"; both when absent.
        validation: whether to leave out metrics that are not measured after every epoch.
        names: those that are wanted; all but those that have to be named when absent.
    """
    return by_name(part.facts["spec"] for part in _parts(task, validation, names))


def measure(
    task: str,
    preds: Float[Tensor, "b c h w"],
    target: Float[Tensor, "b c h w"],
    mask: Bool[Tensor, "b 1 h w"],
    *,
    max_depth: float = float("inf"),
    cosine_epsilon: float = 0.0,
    epsilon: float = 0.0,
    options: Options = NONE,
    validation: bool = False,
    names: Sequence[str] | None = None,
) -> dict[str, Float[Tensor, " b"]]:
    """The registered metrics of a task, one value a frame.

    Args:
        task: "depth" or "normals".
        preds: predicted depth in mm, or normals.
        target: true depth in mm, or normals.
        mask: True where a pixel counts.
        max_depth: upper bound that depth is clipped to.
        cosine_epsilon: passed to functions that have such a parameter.
        epsilon: likewise, in mm.
        options: options of metrics, by their names.
        validation: whether to leave out metrics that are not measured after every epoch.
        names: those that are wanted; all but those that have to be named when absent.

    Raises:
        UserError: a function returns something else than one value a frame. What a function raises itself
            is left as it is.
    """
    limits = {"min_depth": SMALLEST, "max_depth": max_depth}
    limits |= {"cosine_epsilon": cosine_epsilon, "epsilon": epsilon}
    parts = _parts(task, validation, names)
    values: dict[str, Tensor] = {}
    for function_parts in _by_function(parts):
        values |= _called(function_parts, (preds, target, mask), limits, options)
    return {part.name: values[part.name] for part in parts}


def try_metrics(tasks: tuple[str, ...], size_hw: tuple[int, int], options: Options = NONE) -> None:
    """Call every metric of plugins on two synthetic frames, so that an error shows before a training.

    Raises:
        UserError: as `measure`; what a function raises itself is left as it is.
    """
    generator = torch.Generator().manual_seed(0)
    limits = {"min_depth": SMALLEST, "max_depth": float("inf"), "cosine_epsilon": 0.0, "epsilon": 0.0}
    mask = torch.ones(2, 1, *size_hw, dtype=torch.bool)
    for task in tasks:
        noise = torch.rand(2, 2, 1 if task == "depth" else 3, *size_hw, generator=generator)
        preds, target = 50 + 20 * noise if task == "depth" else _facing(noise)
        for parts in _by_function([part for part in _parts(task, False) if part.name not in OURS]):
            _called(parts, (preds, target, mask), limits, options)


def _facing(noise: Tensor) -> Tensor:
    """Unit normals that face the camera."""
    return normalize(0.5 * noise - noise.new_tensor([0.0, 0.0, 1.5]).view(3, 1, 1), dim=-3)


def _parts(task: str | None, validation: bool, names: Sequence[str] | None = None) -> list[Part]:
    order = {name: place for place, name in enumerate(OURS)}
    METRICS.load()
    parts = sorted(METRICS.parts.values(), key=lambda part: order.get(part.name, len(order)))
    specs = [(part, part.facts["spec"]) for part in parts]
    return [
        part
        for part, spec in specs
        if task in (None, spec.task)
        and (spec.in_validation or not validation)
        and (not spec.on_request if names is None else part.name in names)
    ]


def _by_function(parts: list[Part]) -> list[list[Part]]:
    """Group parts by the function that computes them."""
    by_function: dict[Callable[..., Any], list[Part]] = {}
    for part in parts:
        by_function.setdefault(part.build, []).append(part)
    return list(by_function.values())


def _called(
    parts: list[Part], maps: tuple[Tensor, Tensor, Tensor], limits: Mapping[str, float], options: Options
) -> dict[str, Tensor]:
    """The values of the parts that one function computes."""
    (preds, target, mask), build = maps, parts[0].build
    takes = signature(build).parameters
    own = {key: value for part in parts for key, value in options.get(part.name, {}).items()}
    supplied = {key: value for key, value in limits.items() if key in takes}
    if parts[0].facts["spec"].task == "depth" and not takes.keys() >= {"min_depth", "max_depth"}:
        preds = preds.clamp(limits["min_depth"], limits["max_depth"])
    result = build(preds, target, mask, **supplied, **own)
    return {part.name: _checked(part, result, len(preds)) for part in parts}


def _checked(part: Part, result: Any, frames: int) -> Tensor:
    """A metric's values from the result of its function."""
    value = result.get(part.name) if isinstance(result, Mapping) else result
    if isinstance(value, Tensor) and value.shape == (frames,):
        return value
    actual = f"shape {tuple(value.shape)}" if isinstance(value, Tensor) else f"{type(value).__name__}"
    where = place_of(part.build)
    raise UserError(
        f"metric {part.name}: {where} has to return one value a frame, a tensor of shape ({frames},) for "
        f"{frames} frames; got {actual}"
    )
