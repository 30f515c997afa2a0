"""Options of metrics, by name: arguments of the functions that compute them."""

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field, PlainValidator

from col3d.errors import OptionError
from col3d.registry import METRICS
from col3d.registry.refusals import checked


def metric_options(given: Any) -> dict[str, dict[str, Any]]:
    """Options of registered metrics, checked against the signatures of their functions.

    Raises:
        OptionError: a name is unknown, an option breaks a rule, or a function that computes several metrics
            is given options under two of their names.
    """
    if not isinstance(given, Mapping):
        raise OptionError(f"metrics: expected options by the names of metrics, got {given!r}")
    checked_options: dict[str, dict[str, Any]] = {}
    owners: dict[Any, str] = {}
    for name, options in given.items():
        part = METRICS[str(name)]
        if not isinstance(options, Mapping):
            raise OptionError(f"metrics.{name}: expected options, {{OPTION: VALUE}}, got {options!r}")
        checked_options[str(name)] = checked(part.options(), options, f"metrics.{name}")
        first = owners.setdefault(part.build, str(name))
        if options and first != name:
            raise OptionError(f"metrics.{name}: is computed with {first}; give the options under one of them")
    return checked_options


MetricOptions = Annotated[
    dict[str, dict[str, Any]], PlainValidator(metric_options), Field(default_factory=dict)
]
"""Options of metrics by their names; those that are not named have their defaults."""
