"""Reading of type annotations: the rule of a parameter in words, and whether YAML can hold its values."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

PLAIN = (bool, int, float, str, NoneType, Path)


CONTAINERS = (list, tuple, Sequence, dict, Mapping, Literal, Union, UnionType, Annotated)


def rule(annotation: Any) -> str:
    """Describe in words what a value has to be: its type, and the bounds of pydantic or annotated-types.

    >>> rule(Annotated[float, Field(ge=0, lt=1)])
    'float, ge=0, lt=1'
    """
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin in (Union, UnionType):
        return " or ".join(map(rule, inner))
    if origin is Literal:
        return " or ".join(map(repr, inner))
    if origin is Annotated:
        metadata = FieldInfo.from_annotation(annotation).metadata
        bounds = [asdict(bound) for bound in metadata if is_dataclass(bound) and not isinstance(bound, type)]
        return ", ".join(
            [rule(inner[0]), *(f"{key}={value}" for bound in bounds for key, value in bound.items())]
        )
    if annotation is NoneType:
        return "null"
    named = isinstance(annotation, type) and not inner
    return (
        annotation.__name__
        if named
        else str(annotation).replace("typing.", "").replace("collections.abc.", "")
    )


def is_group(annotation: Any) -> bool:
    """Whether a parameter's annotation is a group of options."""
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


def plain(value: Any) -> Any:
    """Convert a default to plain values for YAML: tuples to lists, paths to text, options to a mapping."""
    if isinstance(value, BaseModel):
        value = value.model_dump()
    if isinstance(value, Mapping):
        return {str(key): plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [plain(inner) for inner in value]
    return str(value) if isinstance(value, Path) else value


def bare(annotation: Any) -> Any:
    """Strip `Annotated` from an annotation."""
    return get_args(annotation)[0] if get_origin(annotation) is Annotated else annotation


def plain_part(annotation: Any) -> Any:
    """Drop the arms of a union that no option can be: `float | Tensor` becomes float, in a tuple as well."""
    inner, origin = get_args(annotation), get_origin(annotation)
    if origin in (Union, UnionType):
        arms = [plain_part(arm) for arm in inner if is_plain_type(plain_part(arm))]
        return Union[tuple(arms)] if arms else annotation  # noqa: UP007 - the arms vary
    if origin is tuple:
        return tuple.__class_getitem__(tuple(arm if arm is Ellipsis else plain_part(arm) for arm in inner))
    return annotation


def is_plain_type(annotation: Any) -> bool:
    """Whether YAML can hold every value of a type."""
    annotation = bare(annotation)
    origin = get_origin(annotation)
    if annotation is Any or annotation in (*PLAIN, *CONTAINERS) or origin is Literal or is_group(annotation):
        return True
    inner = [kind for kind in get_args(annotation) if kind is not Ellipsis]
    return origin in CONTAINERS and all(map(is_plain_type, inner))


def is_plain(value: Any) -> bool:
    """Whether YAML can hold a value."""
    if isinstance(value, Mapping):
        return all(isinstance(key, str) and is_plain(inner) for key, inner in value.items())
    if isinstance(value, list | tuple):
        return all(map(is_plain, value))
    return isinstance(value, PLAIN)
