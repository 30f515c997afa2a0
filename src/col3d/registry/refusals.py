"""Validation of options: each fault becomes one line with the option, the rule, the value and a hint."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from col3d.errors import OptionError, UserError
from col3d.nearest_names import nearest_name

BY_NAME = {"task": ("supervised", "adversarial")}
"""Groups that are unions of option classes, with the tags that pydantic puts into an error's location."""

OptionsType = TypeVar("OptionsType", bound=BaseModel)


def check_options(options: type[OptionsType], given: Mapping[str, Any]) -> OptionsType:
    """Validate the options of a program.

    Raises:
        UserError: one line for each option that breaks a rule.
    """
    try:
        return options.model_validate(given)
    except ValidationError as error:
        raise UserError(_lines(options, error)) from None


def validated(options: type[OptionsType], given: Mapping[str, Any], group: str) -> OptionsType:
    """Validate the options of a group.

    Raises:
        OptionError: one line for each that breaks a rule.
    """
    try:
        return options.model_validate(given)
    except ValidationError as error:
        raise OptionError(_lines(options, error, group)) from None


def checked(options: type[BaseModel], given: Mapping[str, Any], group: str) -> dict[str, Any]:
    """Validate keyword arguments as options of a group, and return the converted values.

    Raises:
        OptionError: one line for each that breaks a rule.
    """
    values = validated(options, given, group)
    return {name: getattr(values, name) for name in given}


def _lines(options: type[BaseModel], error: ValidationError, group: str = "") -> str:
    """Return a line for each option that breaks a rule."""
    faults: dict[str, list[ErrorDetails]] = {}
    for detail in error.errors():
        faults.setdefault(f"{group}.{_option(detail)}".strip("."), []).append(detail)
    return "\n".join(_line(options, option, details, group) for option, details in faults.items())


def _option(detail: ErrorDetails) -> str:
    group, *inner = detail["loc"] or ("",)
    chosen = inner[0] if inner and inner[0] in BY_NAME.get(str(group), ()) else None
    parts = [group, *(inner if chosen is None else inner[1:])]
    return ".".join(str(part) for part in parts if not _is_union_branch(str(part)))


def _is_union_branch(part: str) -> bool:
    """Whether part of an error's location is the branch of a union that pydantic tried."""
    return part in ("bool", "int", "float", "str", "none") or "[" in part or part.startswith("constrained-")


def _line(options: type[BaseModel], option: str, details: list[ErrorDetails], group: str) -> str:
    """Describe all faults of one option in a line: a union has a rule for each of its branches."""
    kind, value = details[0]["type"], details[0]["input"]
    if kind == "extra_forbidden":
        path, _, _ = option.rpartition(".")
        inside = path.removeprefix(group).strip(".")
        names = [
            f"{path}.{name}".strip(".") for name in _fields(options, inside.split(".") if inside else [])
        ]
        return f"{option}: no such option{nearest_name(option, names)}"
    if kind == "missing":
        return f"{option}: a value is needed"
    if kind == "union_tag_invalid":
        context = details[0]["ctx"]
        return f"{option}.name: expected one of {context['expected_tags']}, got {context['tag']!r}"
    if kind == "value_error":
        return details[0]["msg"].removeprefix("Value error, ")
    rules = [_rule(detail["msg"]) for detail in details]
    return f"{option}: expected {' or '.join(dict.fromkeys(rules))}, got {value!r}"


RULES = {
    "a valid list": "a list in brackets, [a,b]",
    "a valid tuple": "a list in brackets, [a,b]",
    "a valid dictionary": "a mapping in braces, {a:1,b:2}",
    f"Input is not a valid path for {Path}": "a path",
}
"""Rules of pydantic, and how they read for a command line."""


def _rule(message: str) -> str:
    """Extract the rule from a message of pydantic, in the terms of a command line."""
    rule = message.removeprefix("Input should be ").removeprefix("List should have ")
    return RULES.get(rule, rule)


def _fields(options: type[BaseModel], path: list[str]) -> list[str]:
    """List the names of the options below a path."""
    for name in path:
        field = options.model_fields.get(name)
        kinds = [] if field is None else [field.annotation, *get_args(field.annotation)]
        nested = [kind for kind in kinds if isinstance(kind, type) and issubclass(kind, BaseModel)]
        if not nested:
            return []
        options = max(nested, key=lambda kind: len(kind.model_fields))
    return list(options.model_fields)
