"""Names that are known, and for one that is not the nearest that is: `did you mean 'bts'?`."""

import difflib
from collections.abc import Iterable

from col3d.errors import OptionError


def nearest_name(name: str, known: Iterable[str]) -> str:
    """Return a hint such as `; did you mean 'bts'?`, or an empty string if no known name is close."""
    close = difflib.get_close_matches(name, list(known), n=1, cutoff=0.5)
    return f"; did you mean {close[0]!r}?" if close else ""


def check_known(argument: str, name: str, known: Iterable[str]) -> str:
    """Return `name` if it is one of `known`.

    Raises:
        OptionError: names the argument, the value, the nearest valid name and all valid names.
    """
    known = list(known)
    if name in known:
        return name
    raise OptionError(
        f"{argument}: {name!r} is unknown{nearest_name(name, known)}; known: {', '.join(known)}"
    )
