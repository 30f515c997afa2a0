"""Error messages for bad input on the command line: one line each, with the nearest valid name."""

import re
import shlex
import sys
from collections.abc import Callable, Sequence
from typing import Any

from hydra import compose, initialize_config_dir
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException, OverrideParseException
from omegaconf import OmegaConf
from omegaconf.errors import InterpolationResolutionError

from col3d.cli.files import CONF, is_group, names_in
from col3d.cli.paths import quoted
from col3d.errors import DataError, OptionError, UserError
from col3d.nearest_names import nearest_name
from col3d.registry import GROUPS

EXIT_CODE = 2
MANY = 30
"""Number of names above which an error message does not list them all."""


def refuse(message: str) -> None:
    """Print an error and end the process."""
    print("\n".join(f"error: {line}" for line in message.splitlines()), file=sys.stderr)
    sys.exit(EXIT_CODE)


def explain(error: Exception, config_name: str) -> str:
    """Convert an exception to one line; for Hydra's errors, with the nearest valid name."""
    if isinstance(error, OSError) and not isinstance(error, HydraException):  # some Hydra errors are both
        return f"{error.filename or _folder()}: {error.strerror}" if error.strerror else str(error)
    while isinstance(error, InterpolationResolutionError) and isinstance(error.__context__, Exception):
        error = error.__context__  # raised by a resolver
    if isinstance(error, OverrideParseException):
        return _unreadable(error.override)
    if isinstance(error, DataError | OptionError | UserError):
        return str(error).rpartition("DataError: ")[2].strip()  # a loader's worker adds its traceback
    text = " ".join(f"{error} {error.__cause__ or ''}".split())
    for pattern, explanation in COMPLAINTS.items():
        if match := re.search(pattern, text):
            return explanation(match.group(1), config_name)
    return text


def _folder() -> str:
    """Return the folder of this run, for errors (such as a full disk) that do not name a file."""
    known = HydraConfig.initialized() and not OmegaConf.is_missing(HydraConfig.get().runtime, "output_dir")
    return HydraConfig.get().runtime.output_dir if known else "a file"


def _unknown_option(option: str, config_name: str) -> str:
    if option == "checkpoint" and config_name in ("train", "benchmark"):
        return (
            "checkpoint: init.checkpoint=PATH begins from weights; the same command goes on with a training"
        )
    return f"{option}: no such option{nearest_name(option, option_names(config_name, sys.argv[1:]))}"


def _unknown_choice(choice: str, config_name: str) -> str:
    group, _, name = choice.rpartition("/")
    known = names_in(group)
    listed = (
        f"known: {', '.join(known)}" if len(known) <= MANY else f"col3d list {group}s has all {len(known)}"
    )
    of_others = "; one of a plugin needs plugins=[...]" if group in GROUPS else ""
    return f"{group}: {name!r} is unknown{nearest_name(name, known)}; {listed}{of_others}"


def _missing_value(option: str, config_name: str) -> str:
    return f"{option}: a value is needed; give {option}=..."


def _bare_list(option: str, config_name: str) -> str:
    brackets = "" if is_group(option) else "write a list in brackets, [0.5,0.3,0.2], or "
    return f"{option}: {brackets}sweep over the values with -m"


def _unreadable(override: str) -> str:
    option, equals, value = override.lstrip("+").partition("=")
    if not equals:
        return f"{override}: not key=value"
    if value.startswith("["):
        return f"{option}: write lists without spaces, such as loss.lambdas=[0.5,0.3,0.2]; got {value}"
    twice = shlex.quote(f"{option}={quoted(value)}")
    return f"{option}: {value} cannot be read as it stands; quote it twice: {twice}"


COMPLAINTS: dict[str, Callable[[str, str], str]] = {
    r"Could not override '([^']+)'": _unknown_option,
    r"Could not find '([^']+)'": _unknown_choice,
    r"Missing mandatory value.*full_key: (\S+)": _missing_value,
    r"Ambiguous value for argument '([^=]+)=": _bare_list,
}


def option_names(config_name: str, words: Sequence[str]) -> list[str]:
    """List the dotted names of all options, with the groups that a command line chooses."""
    chosen = [text for text in words if is_group(text.partition("=")[0]) and "," not in text]
    with initialize_config_dir(str(CONF), version_base="1.3"):
        config = OmegaConf.to_container(compose(config_name, chosen), resolve=False)
    return _dotted(config) + ["experiment"] * (config_name == "train")


def _dotted(node: Any, prefix: str = "") -> list[str]:
    if not isinstance(node, dict):
        return [prefix]
    inside = [name for key, value in node.items() for name in _dotted(value, f"{prefix}.{key}".strip("."))]
    return [prefix, *inside] if prefix else inside
