"""Quoting of paths and names on the command line, so that Hydra's grammar leaves them as typed."""

import re
from collections.abc import Collection, Sequence

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException

DATA = r"data\.((also\.\w+|test)\.)?"
PATHS = re.compile(
    rf"{DATA}(root|store|layout\.(image|depth|camera_file))|prepare\.out|benchmark\.output|model\.pretrained"
    r"|hydra\.(run|sweep)\.dir|init\.checkpoint|output_dir|root|input|output|checkpoint|samples|camera|video"
    r"|predictions|reading\.(depth|normals|name)"
)
NAMES = re.compile(rf"{DATA}split\.(train|val|test)|videos")
NO_PATHS = {("predict", "video")}
"""(program, option) where an option that is a path in other programs is not one."""
MAY_BE_NULL = (
    *("checkpoint", "init.checkpoint", "output_dir", "root", "prepare.out", "model.pretrained", "samples"),
    *("camera", "predictions", "reading.depth", "reading.normals", "reading.name"),
)
SWEEPS = ("-m", "--multirun", "hydra.mode=MULTIRUN")
QUOTED = r"""(?:"(?:[^"\\]|\\.)*"|'(?:[^'\\]|\\.)*')"""
ENTRY = re.compile(rf"\s*(?:({QUOTED})\s*(?=,|$)|([^,]*))")
LISTS = re.compile(r"\[[^\[\]]*\](,\s*\[[^\[\]]*\])+")
SEARCHED = re.compile(r"(choice|range|interval|glob|shuffle|sort|tag)\(.*\)")


def as_typed(arguments: list[str], config_name: str) -> list[str]:
    """Quote paths and names in arguments that Hydra would otherwise refuse, split, or read as numbers.

    In a sweep a comma still separates values.
    """
    sweep = any(word in arguments for word in SWEEPS)
    return [_as_typed(argument, config_name, sweep) for argument in arguments]


def quoted_again(overrides: Sequence[str]) -> list[str]:
    """Convert overrides of Hydra's sweeper, which have backslashes in names, to quoted arguments."""
    return [_quoted_again(override) for override in overrides]


def _quoted_again(override: str) -> str:
    option, _, value = override.partition("=")
    name = option.lstrip("+")
    if "\\" not in value or not (NAMES.fullmatch(name) or PATHS.fullmatch(name)):
        return override
    read = OverridesParser.create().parse_override(override).value()
    names = ",".join(quoted(str(entry)) for entry in read) if isinstance(read, list) else None
    return f"{option}={quoted(str(read)) if names is None else f'[{names}]'}"


def _as_typed(argument: str, config_name: str, sweep: bool) -> str:
    option, equals, value = argument.partition("=")
    name = option.lstrip("+")
    if not equals or _is_quoted(value) or "${" in value or (sweep and SEARCHED.fullmatch(value)):
        return argument
    if NAMES.fullmatch(name) and value.startswith("[") and value.endswith("]"):
        several = sweep and LISTS.fullmatch(value)
        lists = re.split(r"\],\s*\[", value[1:-1]) if several else [value[1:-1]]
        return f"{option}={','.join(f'[{_each_quoted(names)}]' for names in lists)}"
    if not PATHS.fullmatch(name) or (config_name, name) in NO_PATHS:
        return argument
    nullable = name in MAY_BE_NULL
    if (value in ("", "null") and nullable) or (name == "camera" and value.startswith("[")):
        return argument
    if sweep and "," in value:
        return f"{option}={_each_quoted(value, ('null',) if nullable else ())}"
    return f"{option}={_quoted_if_needed(value)}"


def _each_quoted(values: str, unquoted: Collection[str] = ()) -> str:
    return ",".join(entry if entry in unquoted else _quoted_in_list(entry) for entry in separated(values))


def _quoted_in_list(entry: str) -> str:
    """Quote an entry of a list if needed: a backslash would escape the comma or bracket after it."""
    return quoted(entry) if "\\" in entry and not _is_quoted(entry) else _quoted_if_needed(entry)


def separated(values: str) -> list[str]:
    """Split values at commas that are not inside quotes.

    >>> separated("001, it's, 'b, c'")
    ['001', "it's", "'b, c'"]
    """
    entries, start = [], 0
    while start <= len(values) and (match := ENTRY.match(values, start)):
        entries.append((match[1] or match[2]).strip())
        start = match.end() + 1
    return entries


def quoted(value: str) -> str:
    """Quote a value so that Hydra reads it back; in Hydra a backslash before a quote escapes it."""
    if not set(value) & set('"\\'):
        return f'"{value}"'
    inside = re.sub(r"(\\*)'", r"\1\1\\'", value)
    return "'" + re.sub(r"(\\+)$", r"\1\1", inside) + "'"


def _quoted_if_needed(value: str) -> str:
    if not value or _is_quoted(value):
        return value
    try:
        override = OverridesParser.create().parse_override(f"x={value}")
        plain = not override.is_sweep_override() and override.value() == value
    except HydraException:
        plain = False
    return value if plain else quoted(value)


def _is_quoted(value: str) -> bool:
    return len(value) > 1 and value[0] == value[-1] and value[0] in "'\""
