"""Bad input in one line: the option, the rule, what came and the nearest valid name."""

from collections.abc import Mapping
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from col3d.checks import UserError, nearest_name

OptionsType = TypeVar("OptionsType", bound=BaseModel)


def check_options(options: type[OptionsType], given: Mapping[str, Any]) -> OptionsType:
    """The given options, checked.

    Raises:
        UserError: one line for each option that breaks a rule.
    """
    try:
        return options.model_validate(given)
    except ValidationError as error:
        lines = dict.fromkeys(_line(options, detail) for detail in error.errors())
        raise UserError("\n".join(lines)) from None


def _line(options: type[BaseModel], detail: ErrorDetails) -> str:
    path = [str(part) for part in detail["loc"] if not _is_union_branch(str(part))]
    option = ".".join(path)
    if detail["type"] == "extra_forbidden":
        names = [".".join([*path[:-1], name]) for name in _fields(options, path[:-1])]
        return f"{option}: no such option{nearest_name(option, names)}"
    if detail["type"] == "value_error" and not path:
        return detail["msg"].removeprefix("Value error, ")
    rule = detail["msg"].replace("Input should be", "expected").replace("List should have", "expected")
    return f"{option}: {rule}, got {detail['input']!r}"


def _is_union_branch(part: str) -> bool:
    """Pydantic names the branch of a union it tried inside the location."""
    return part in ("int", "float", "none") or "[" in part


def _fields(options: type[BaseModel], path: list[str]) -> list[str]:
    """Names of the options below a path."""
    for name in path:
        field = options.model_fields.get(name)
        kinds = [] if field is None else [field.annotation, *get_args(field.annotation)]
        nested = [kind for kind in kinds if isinstance(kind, type) and issubclass(kind, BaseModel)]
        if not nested:
            return []
        options = nested[0]
    return list(options.model_fields)
