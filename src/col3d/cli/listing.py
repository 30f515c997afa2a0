"""`col3d list`, `col3d describe` and `col3d report`: programs that take plain words instead of options."""

from collections.abc import Sequence

from col3d.cli.parts import load_plugins
from col3d.errors import OptionError
from col3d.nearest_names import nearest_name
from col3d.registry import KINDS, Registry, describe


def list_parts(name: str, words: list[str]) -> int | None:
    """Print the names and first sentences of the parts of a kind, or the kinds if none is given.

    Raises:
        OptionError: there is no such kind.
    """
    given = _without_plugins(words)
    if not given or given[0] in ("--help", "-h"):
        print(f"col3d list KIND [plugins=[...]], of {', '.join(map(_plural, KINDS))}")
        return None
    registry = _registry(given[0])
    parts = [registry[part] for part in registry.names()]
    width = max(len(part.name) for part in parts)
    for part in parts:
        print(f"{part.name:{width}}  {part.summary}".rstrip())
    return None


def describe_part(name: str, words: list[str]) -> int | None:
    """Print a part's description and its options.

    Raises:
        OptionError: there is no such part.
    """
    given = _without_plugins(words)
    if len(given) != 2:
        print(f"col3d describe KIND NAME [plugins=[...]], of {', '.join(map(_plural, KINDS))}")
        return None
    print(describe(_registry(given[0]).kind, given[1]))
    return None


def report(name: str, words: list[str]) -> int | None:
    """Write the report of all runs below a folder."""
    from col3d.reports.__main__ import main

    return main(words)


def _registry(kind: str) -> Registry:
    """Return the registry of a kind, named in the singular or the plural."""
    kinds = {_plural(name): registry for name, registry in KINDS.items()}
    known = {**kinds, **KINDS}
    if kind not in known:
        near = nearest_name(kind, known)
        raise OptionError(f"{kind!r} is no kind of parts{near}; there are {', '.join(kinds)}")
    return known[kind]


def _plural(kind: str) -> str:
    return f"{kind}es" if kind.endswith("s") else f"{kind}s"


def _without_plugins(words: Sequence[str]) -> list[str]:
    return [word for word in load_plugins(words) if not word.lstrip("+").startswith("plugins=")]
