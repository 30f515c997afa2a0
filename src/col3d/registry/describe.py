"""Listing and description of registered parts, as text."""

from collections.abc import Iterator, Mapping
from typing import Any

from pydantic_core import PydanticUndefined

from col3d.errors import OptionError
from col3d.nearest_names import nearest_name
from col3d.registry.annotations import is_group, plain, rule
from col3d.registry.kinds import KINDS
from col3d.registry.parts import Registry
from col3d.registry.schema import place_of


def available(kind: str) -> list[str]:
    """List the names of the parts of a kind, such as "model"."""
    return _registry(kind).names()


def describe(kind: str, name: str) -> str:
    """Describe a part: where it comes from, its first sentence, and a line for each of its options."""
    part = _registry(kind)[name]
    lines = [f"{part.kind} {part.name} ({place_of(part.build)})", part.summary, ""]
    above = KINDS[part.kind].place.format(name=part.name)
    return "\n".join([*lines, *_described(part.parameters(), above)])


def _described(options: Mapping[str, tuple[Any, Any]], above: str) -> Iterator[str]:
    for name, (annotation, default) in options.items():
        if is_group(annotation):
            inside = {
                key: (field.annotation, field.default) for key, field in annotation.model_fields.items()
            }
            yield from _described(inside, f"{above}.{name}")
        else:
            usual = "needed" if default is PydanticUndefined else f"{plain(default)!r} unless given"
            yield f"  {above}.{name}: {rule(annotation)}; {usual}"


def _registry(kind: str) -> Registry:
    if kind not in KINDS:
        raise OptionError(f"kind: {kind!r} is unknown{nearest_name(kind, KINDS)}; known: {', '.join(KINDS)}")
    return KINDS[kind]
