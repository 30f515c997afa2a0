"""Packages of other people whose parts join those of this one.

They are named on the command line (`plugins=[mylab]`), in the environment (`COL3D_PLUGINS=mylab,theirs`), or
by an installed package itself (entry points of the group `col3d.plugins`).
"""

import functools
import hashlib
import importlib
import importlib.metadata
import os
import sys
from collections.abc import Iterable
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

from col3d.errors import OptionError

VARIABLE = "COL3D_PLUGINS"
GROUP = "col3d.plugins"

loaded: dict[str, Path] = {}
"""Where the plugins that were imported lie, by name: a package's folder, or the file of a module alone."""


def load(names: Iterable[str] = ()) -> list[str]:
    """Import plugins: those that are given, those of the environment and those that are installed.

    Names that are given join the environment, so that processes which this one starts know them as well.

    Returns:
        Names of all that are loaded.

    Raises:
        OptionError: there is no package of that name. What goes wrong inside of one keeps its traceback.
    """
    given = [*_of_environment(), *names]
    os.environ.update({VARIABLE: ",".join(dict.fromkeys(given))} if given else {})
    for name in dict.fromkeys([*given, *_installed()]):
        if name not in loaded:
            loaded[name] = _imported(name)
    return list(loaded)


def configurations() -> list[Path]:
    """Folders `conf` of the loaded plugins, which join the search path of the configuration."""
    return [folder / "conf" for folder in loaded.values() if (folder / "conf").is_dir()]


def code() -> dict[str, str]:
    """A sum over the Python files of each loaded plugin: a version need not change with the code."""
    return {name: code_sum(place) for name, place in loaded.items()}


def code_sum(place: Path) -> str:
    """Of all Python files in a folder, or of the one that is named."""
    total = hashlib.blake2b(digest_size=8)
    for path in [place] if place.is_file() else sorted(place.rglob("*.py")):
        if path.is_file():  # an editor's lock is a link to nowhere
            total.update(f"{path.relative_to(place).as_posix()}\0".encode() + path.read_bytes())
    return total.hexdigest()


def versions() -> dict[str, str]:
    """Versions of the loaded plugins; "unknown" for one that is not installed."""
    distributions = importlib.metadata.packages_distributions()
    found = {}
    for name in loaded:
        owners = distributions.get(name.partition(".")[0], [])
        found[name] = importlib.metadata.version(owners[0]) if owners else "unknown"
    return found


def _of_environment() -> list[str]:
    return [name.strip() for name in os.environ.get(VARIABLE, "").split(",") if name.strip()]


@functools.cache
def _installed() -> list[str]:
    return [point.module for point in importlib.metadata.entry_points(group=GROUP)]


def _imported(name: str) -> Path:
    here = str(Path.cwd())
    if here not in sys.path:  # an installed command does not look where it is called, as `python -m` does
        sys.path.append(here)
    top = name.partition(".")[0]
    if top in sys.stdlib_module_names:
        raise OptionError(f"plugins: {top} is a module of Python itself: give the package another name")
    if not all(part.isidentifier() for part in name.split(".")) or find_spec(top) is None:
        raise OptionError(
            f"plugins: there is no package {name!r}: install it, or put its folder on PYTHONPATH"
        )
    try:
        module = importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name != name:
            raise
        raise OptionError(f"plugins: the package {top} has no module {name!r}") from None
    return _place(module)


def _place(module: ModuleType) -> Path:
    """Its package's folder, which need not have an `__init__.py`, or the file of one that is in none."""
    if folders := getattr(module, "__path__", None):
        return Path(next(iter(folders)))
    file = Path(module.__file__ or module.__name__)
    return file.parent if "." in module.__name__ else file
