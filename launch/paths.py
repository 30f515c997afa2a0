"""Paths and names on the command line reach a program as they are typed, whatever Hydra's grammar is."""

import re

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException

DATA = r"data\.((also\.\w+|test)\.)?"
PATHS = re.compile(
    rf"{DATA}(root|store|layout\.(image|depth|camera_file))|prepare\.out|benchmark\.output|model\.pretrained"
    r"|hydra\.(run|sweep)\.dir|init\.checkpoint|output_dir|root|input|output|checkpoint|samples|camera|video"
)
NAMES = re.compile(rf"{DATA}split\.(train|val|test)")
NO_PATHS = {("predict", "video")}
"""Programs in which an option that is a path in others is none."""
MAY_BE_NULL = (
    *("checkpoint", "init.checkpoint", "output_dir", "root", "prepare.out", "model.pretrained", "samples"),
    "camera",
)
SWEEPS = ("-m", "--multirun", "hydra.mode=MULTIRUN")


def as_typed(arguments: list[str], config_name: str) -> list[str]:
    """Arguments with quotes around paths and names that Hydra would else refuse, split, or take for numbers.

    In a sweep a comma goes on to separate values.
    """
    sweep = any(word in arguments for word in SWEEPS)
    return [_as_typed(argument, config_name, sweep) for argument in arguments]


def _as_typed(argument: str, config_name: str, sweep: bool) -> str:
    option, equals, value = argument.partition("=")
    name = option.lstrip("+")
    if not equals or _is_quoted(value) or "${" in value or (sweep and "," in value):
        return argument
    if NAMES.fullmatch(name) and value.startswith("[") and value.endswith("]"):
        names = value[1:-1].split(",")
        return f"{option}=[{','.join(_quoted_if_needed(entry.strip()) for entry in names)}]"
    if not PATHS.fullmatch(name) or (config_name, name) in NO_PATHS:
        return argument
    if (value in ("", "null") and name in MAY_BE_NULL) or (name == "camera" and value.startswith("[")):
        return argument
    return f"{option}={_quoted_if_needed(value)}"


def quoted(value: str) -> str:
    """A value as Hydra reads it back; a backslash before a quote stands for the character after it."""
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
