"""Identity of a run: the hash of its relevant options, and comparison of options."""

import hashlib
import json
from collections.abc import Mapping
from typing import Any

from col3d.registry.schema import Options
from col3d.registry.unrelated import UNRELATED, UNRELATED_INSIDE


def hash_of(options: Options) -> str:
    """Compute the hash of all options that the weights and numbers of a run depend on."""
    content = _without_nulls(options.model_dump(mode="json", exclude=UNRELATED))
    for group, name in UNRELATED_INSIDE:
        content[group].pop(name, None)
    content = _without_nulls(content)
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def differing(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """List the relevant options that differ; null counts as absent."""
    before, now = _without_nulls(before), _without_nulls(now)
    names = []
    for name in sorted((before.keys() | now.keys()) - UNRELATED):
        old, new = before.get(name), now.get(name)
        if isinstance(old or new, dict) and isinstance(new or old, dict):
            old, new = old or {}, new or {}
            inner = (k for k in sorted(old.keys() | new.keys()) if old.get(k) != new.get(k))
            names += [f"{name}.{k}" for k in inner if (name, k) not in UNRELATED_INSIDE]
        elif old != new:
            names.append(name)
    return names


def _without_nulls(node: Any) -> Any:
    """Remove options that are null or empty, so that a new option does not change earlier runs."""
    if not isinstance(node, Mapping):
        return node
    inside = {name: _without_nulls(value) for name, value in node.items()}
    return {name: value for name, value in inside.items() if value is not None and value != {}}
