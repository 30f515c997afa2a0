"""Read options from runs' config.yaml, and tell whether two runs are repetitions of each other."""

import json
from typing import Any

from col3d.registry.earlier import ADDED
from col3d.registry.unrelated import UNRELATED, UNRELATED_INSIDE

BETWEEN_REPETITIONS = {*UNRELATED, "seed", "preset", "variant", "protocol"}
"""Groups and options that may differ between repetitions; the protocol is part of a table's setting."""
INSIDE = {*map(".".join, UNRELATED_INSIDE), "data.root", "trainer.accelerator"}
MISSING = object()
Loss = tuple[tuple[str, ...], tuple[float, ...]]
"""The terms, as a formula names them, and their weights."""


def at(options: dict[str, Any], path: str) -> Any:
    """The value of a dotted option, None where an older run does not have it."""
    node: Any = options
    for key in path.split("."):
        node = node.get(key) if isinstance(node, dict) else None
    return node


def loss_of(options: dict[str, Any]) -> Loss:
    """Terms and weights of a run's loss."""
    terms = at(options, "loss.terms") or {}
    weights = at(options, "loss.lambdas") or ()
    return tuple(_term(given) for given in terms.values()), tuple(float(weight) for weight in weights)


def _term(given: Any) -> str:
    """A term's name, with its options where they are not as in the paper; its first epoch is left out."""
    content = given if isinstance(given, dict) else {"term": given}
    usual = {"term": content.get("term"), "geometry": "rays"}
    changed = {k: v for k, v in content.items() if k != "from_epoch" and usual.get(k) != v}
    arguments = ", ".join(f"{name}={value}" for name, value in changed.items())
    return f"{content.get('term')}({arguments})" if arguments else str(content.get("term"))


def fingerprint(options: dict[str, Any]) -> str:
    """Text that is equal for runs that differ only by seed and by where and how they are written."""
    return json.dumps(_related(options), sort_keys=True, default=str)


def differing(one: dict[str, Any], other: dict[str, Any]) -> str:
    """Names and values of the options in which runs differ, as text."""
    first, second = _related(one), _related(other)
    names = sorted(name for name in first.keys() | second.keys() if first.get(name) != second.get(name))
    return ", ".join(f"{name} ({first.get(name)}, {second.get(name)})" for name in names)


def _related(options: dict[str, Any]) -> dict[str, Any]:
    """Dotted options that matter; None, and defaults of options that older runs lack, count as not given."""
    dotted = _dotted(options, "")
    flat = {name: value for name, value in dotted if value is not None and ADDED.get(name, MISSING) != value}
    unread = {"phantom"} if at(options, "data.name") != "phantom" else set()
    return {
        name: value
        for name, value in flat.items()
        if name.partition(".")[0] not in BETWEEN_REPETITIONS | unread and name not in INSIDE
    }


def _dotted(node: Any, prefix: str) -> list[tuple[str, Any]]:
    if not isinstance(node, dict):
        return [(prefix, node)]
    return [pair for key, value in node.items() for pair in _dotted(value, f"{prefix}.{key}".strip("."))]
