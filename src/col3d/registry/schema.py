"""Pydantic models of options, made from the signature of a class or a function."""

import collections.abc
import functools
import inspect
import warnings
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType, NoneType
from typing import Annotated, Any, get_args, get_type_hints

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, create_model, field_validator
from pydantic_core import PydanticCustomError, PydanticUndefined

from col3d.errors import OptionError
from col3d.nearest_names import nearest_name
from col3d.registry.annotations import bare, is_group, is_plain, is_plain_type, plain, plain_part

LARGEST, LARGEST_WHOLE = 1e30, 1e18

CHECKERS_NAMES = {**vars(collections.abc), "Iterable": Sequence}
"""Names that libraries import for type checkers only; an `Iterable` becomes a `Sequence` because pydantic
validates an iterable lazily."""


def _no_empty_path(value: Any) -> Any:
    if value == "":
        raise PydanticCustomError("no_text", "text that is not empty")
    return value


NoneWord = BeforeValidator(lambda value: None if value == "none" else value)
"""Validator that reads `none` on a command line as null."""


class Options(BaseModel):
    """Base of all option classes: undeclared options are refused, and checked ones are immutable."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, protected_namespaces=())

    @field_validator("*")
    @classmethod
    def _are_usable(cls, value: Any) -> Any:
        """Refuse numbers that are too large for torch's float32 or int64, and empty text.

        Torch's own errors do not name the option, and an empty path would be the current folder.
        """
        for text in value if isinstance(value, list) else [value]:
            if isinstance(text, str) and (not text.strip() or "\0" in text):
                raise PydanticCustomError("no_text", "text that is not empty")
        for number in value if isinstance(value, list) else [value]:
            most = LARGEST_WHOLE if isinstance(number, int) else LARGEST
            if isinstance(number, int | float) and abs(number) > most:
                raise PydanticCustomError("too_large", f"numbers between {-most:g} and {most:g}")
        return value


class SignatureError(TypeError):
    """A parameter that no option can set; the message names the callable and the parameter."""


def parameters(build: Callable[..., Any], supplied: Collection[str] = ()) -> dict[str, tuple[Any, Any]]:
    """Return the annotation and default of the parameters that can be options, by name.

    Args:
        build: a class or a function. Parameters without an annotation take any plain value; those whose
            default is no plain value (such as a class) are skipped and keep it.
        supplied: names of parameters that the program supplies.

    Returns:
        Name to (annotation, default); a parameter without a default has pydantic's `PydanticUndefined`.

    Raises:
        SignatureError: a parameter has no default and no type that a value of an option can have, or an
            annotation cannot be resolved.

    >>> def net(image, dropout: float = 0.1, *, norm: type = dict): ...
    >>> parameters(net, supplied=("image",))
    {'dropout': (<class 'float'>, 0.1)}
    """
    options = {}
    hints = _hints(build)
    for name, parameter in inspect.signature(build).parameters.items():
        rest = parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD)
        if rest or name in supplied or name.startswith("_"):
            continue
        annotation = plain_part(hints.get(name, Any))
        required = parameter.default is parameter.empty
        if not is_plain_type(annotation) or not (required or is_plain(parameter.default)):
            if required:
                raise SignatureError(
                    f"{place_of(build)}: parameter {name!r} needs a default, or a type of plain values "
                    f"(numbers, text, lists of them); it has {annotation}"
                )
            continue
        if parameter.kind is parameter.POSITIONAL_ONLY:
            raise SignatureError(
                f"{place_of(build)}: parameter {name!r} must be one that can be given by name"
            )
        options[name] = (annotation, PydanticUndefined if required else parameter.default)
    return options


def options_of(
    build: Callable[..., Any],
    base: type[Options] = Options,
    supplied: Collection[str] = (),
    rules: Mapping[str, Any] = MappingProxyType({}),
) -> type[Options]:
    """Make a pydantic model of a callable's options that extends `base`, whose rules hold for both.

    Args:
        build: a class or a function.
        base: model with further options.
        supplied: names of parameters that the program supplies.
        rules: pydantic's `Field` by name, added to parameters whose default is a number.

    Raises:
        SignatureError: as `parameters`.
    """
    fields: dict[str, Any] = {}
    for name, (annotation, default) in parameters(build, supplied).items():
        may_be_none = default is None or NoneType in get_args(bare(annotation))
        kind = Annotated[annotation | None, NoneWord] if may_be_none else annotation
        if Path in (annotation, *get_args(annotation)):
            kind = Annotated[kind, BeforeValidator(_no_empty_path)]
        if name in rules and isinstance(default, int | float):
            kind = Annotated[kind, rules[name]]
        usual = default
        if name in base.model_fields:
            known = base.model_fields[name]
            kind, usual = Annotated[known.annotation, known], default or known.default
        fields[name] = (kind, Field(default=usual, validate_default=True))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # a parameter may have the name of a pydantic method
        return create_model(home_of(build).__name__, __base__=base, **fields)


def check_names(group: str, given: Mapping[str, Any], options: type[BaseModel]) -> None:
    """Refuse options that a part does not have.

    Args:
        group: where the options are given, such as "scheduler".
        given: the given options.
        options: model of the known options.

    Raises:
        OptionError: one line for each unknown option, with the nearest name.
    """
    known = [f"{group}.{name}" for name in options.model_fields]
    unknown = [f"{group}.{name}" for name in given if name not in options.model_fields]
    if unknown:
        raise OptionError("\n".join(f"{name}: no such option{nearest_name(name, known)}" for name in unknown))


def defaults(options: Mapping[str, tuple[Any, Any]]) -> dict[str, Any]:
    """Convert the result of `parameters` to defaults for YAML: `???` where required, groups as mappings.

    >>> defaults({"width": (int, 4), "height": (int, PydanticUndefined)})
    {'width': 4, 'height': '???'}
    """
    return {name: _default(annotation, default) for name, (annotation, default) in options.items()}


def _default(annotation: Any, default: Any) -> Any:
    if is_group(annotation) and default is PydanticUndefined:
        fields = annotation.model_fields.items()
        return {name: _default(field.annotation, field.default) for name, field in fields}
    return "???" if default is PydanticUndefined else plain(default)


def home_of(build: Callable[..., Any]) -> Any:
    """Return the class or function behind a callable, which has a name, a module and a docstring.

    Raises:
        SignatureError: it cannot be called.

    >>> home_of(functools.partial(dict, a=1))
    <class 'dict'>
    """
    if isinstance(build, functools.partial):
        return home_of(build.func)
    if not callable(build):
        raise SignatureError(f"expected a class or a function, got {build!r}")
    return build if inspect.isclass(build) or inspect.isroutine(build) else type(build)


def place_of(build: Callable[..., Any]) -> str:
    """Return the qualified name of a callable's class or function, for messages."""
    home = home_of(build)
    return f"{home.__module__}.{home.__qualname__}"


def _hints(build: Callable[..., Any]) -> dict[str, Any]:
    if isinstance(build, functools.partial):
        return _hints(build.func)
    home = home_of(build)
    target = home if inspect.isroutine(home) else home.__init__ if home is build else home.__call__
    with suppress(NameError):
        return get_type_hints(target, include_extras=True)
    try:  # names that are imported for type checkers only
        return get_type_hints(target, localns=CHECKERS_NAMES, include_extras=True)
    except NameError as error:
        raise SignatureError(f"{place_of(build)}: {error} (in its annotations)") from None
