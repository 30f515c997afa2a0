"""Options of additional callbacks: named entries of a mapping, each a registered callback."""

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import PlainValidator, SerializeAsAny

from col3d.errors import OptionError
from col3d.registry import CALLBACKS
from col3d.registry.refusals import validated
from col3d.registry.schema import Options, check_names

GROUP = "callbacks.more"


class CallbackEntry(Options):
    """A callback by name; the parameters of its class join it."""

    callback: str


def callback_entries(given: Any) -> dict[str, CallbackEntry]:
    """Validate entries against the signatures of their callbacks; a name alone means the defaults.

    Raises:
        OptionError: a line for each option that breaks a rule.
    """
    if not isinstance(given, Mapping):
        raise OptionError(f"{GROUP}: entries have names, {GROUP}.ENTRY=NAME, got {given!r}")
    return {str(name): _entry(str(name), value) for name, value in given.items() if value is not None}


def _entry(name: str, given: Any) -> CallbackEntry:
    if isinstance(given, CallbackEntry):
        return given
    content = {"callback": given} if isinstance(given, str) else given
    if not isinstance(content, Mapping) or not isinstance(content.get("callback"), str):
        raise OptionError(f"{GROUP}.{name}: a callback is a name or {{callback: NAME, ...}}, got {given!r}")
    place = f"{GROUP}.{name}"
    part = CALLBACKS[content["callback"]]
    kind = part.options(CallbackEntry)
    check_names(place, content, kind)
    entry = validated(kind, content, place)
    assert isinstance(entry, CallbackEntry)
    _try(place, entry)
    return entry


def _try(place: str, entry: CallbackEntry) -> None:
    """Build a callback, to report violations of Lightning's rules; a user's own code keeps its traceback."""
    part = CALLBACKS[entry.callback]
    try:
        callback = part.build(**own_options(entry))
    except Exception as error:
        if part.package not in ("lightning", "col3d"):
            raise
        raise OptionError(f"{place}: {entry.callback}: {' '.join(str(error).split())}") from None
    part.made(callback, "on_train_epoch_end")


def own_options(entry: CallbackEntry) -> dict[str, Any]:
    """Select the options of the callback's class."""
    return CALLBACKS[entry.callback].own(entry)


def callbacks_of(entries: Mapping[str, CallbackEntry]) -> list[Any]:
    """Build the callbacks, in the order of their entries."""
    return [CALLBACKS[entry.callback].build(**own_options(entry)) for entry in entries.values()]


Entries = Annotated[dict[str, SerializeAsAny[CallbackEntry]], PlainValidator(callback_entries)]
"""Options of callbacks by the names of their entries."""
