"""Options of loggers, by the names of registered loggers; `csv` adds none beside metrics.csv."""

from collections.abc import Mapping
from importlib.util import find_spec
from typing import Annotated, Any

from pydantic import PlainValidator, SerializeAsAny

from col3d.errors import OptionError, UserError
from col3d.registry import LOGGERS, Part
from col3d.registry.refusals import validated
from col3d.registry.schema import Options, check_names, defaults

ALWAYS = "csv"
FORBIDDEN_IN_NAMES = set("/\\#?%:")
"""Characters that W&B and others do not accept in the name of a project."""


def logger_entries(given: Any) -> dict[str, Options]:
    """Validate the options of loggers against their signatures, by name.

    Raises:
        OptionError: a line for each option that breaks a rule.
    """
    if not isinstance(given, Mapping):
        raise OptionError(f"logger: expected logger=NAME or logger=[NAME,NAME], got {given!r}")
    return {str(name): _entry(str(name), value) for name, value in given.items() if name != ALWAYS}


def _entry(name: str, given: Any) -> Options:
    if isinstance(given, Options):
        return given
    part, place = LOGGERS[name], f"logger.{name}"
    if not isinstance(given, Mapping):
        raise OptionError(f"{place}: expected options such as {place}.prefix=..., got {given!r}")
    kind = part.options()
    check_names(place, given, kind)
    options = validated(kind, given, place)
    project = getattr(options, "project", None)
    if isinstance(project, str) and FORBIDDEN_IN_NAMES & set(project):
        raise OptionError(f"{place}.project: expected a name without / \\ # ? % :, got {project!r}")
    return options


def check_installed(entries: Mapping[str, Options]) -> None:
    """Refuse loggers whose packages are not installed.

    Raises:
        UserError: says what to install.
    """
    for name in entries:
        facts = LOGGERS[name].facts
        if facts["needs"] and not any(find_spec(package) for package in facts["needs"]):
            raise UserError(
                f"logger: {name} needs a package that is not installed: pip install '{facts['install']}'"
            )


def node(part: Part) -> dict[str, Any]:
    """Return what `logger=NAME` adds to a configuration: every option with its default."""
    return {part.name: defaults(part.parameters())}


Loggers = Annotated[dict[str, SerializeAsAny[Options]], PlainValidator(logger_entries)]
"""Options of loggers by name."""
