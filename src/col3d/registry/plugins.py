"""Plugins: loading of other packages that register parts.

Plugins are named on the command line (`plugins=[mylab]`), in the environment (`COL3D_PLUGINS=mylab,theirs`),
or by an installed package itself (entry points of the group `col3d.plugins`).
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
"""Paths of the imported plugins by name: the folder of a package, or the file of a single module."""


def load(names: Iterable[str] = ()) -> list[str]:
    """Import plugins: the given ones, those of the environment and the installed ones.

    The given names are added to the environment, so that child processes load them as well.

    Returns:
        Names of all loaded plugins.

    Raises:
        OptionError: there is no package of that name. Errors inside a plugin keep their traceback.
    """
    given = [*_of_environment(), *names]
    os.environ.update({VARIABLE: ",".join(dict.fromkeys(given))} if given else {})
    for name in dict.fromkeys([*given, *_installed()]):
        if name not in loaded:
            loaded[name] = _imported(name)
    return list(loaded)


def configurations() -> list[Path]:
    """List the folders `conf` of the loaded plugins, which are on the search path of the configuration."""
    return [folder / "conf" for folder in loaded.values() if (folder / "conf").is_dir()]


def code() -> dict[str, str]:
    """Return the checksum of each loaded plugin's Python files: its version need not change with its code."""
    return {name: code_sum(place) for name, place in loaded.items()}


def code_sum(place: Path) -> str:
    """Compute the checksum of all Python files in a folder, or of a single file."""
    total = hashlib.blake2b(digest_size=8)
    for path in [place] if place.is_file() else sorted(place.rglob("*.py")):
        if path.is_file():  # an editor's lock file is a broken link
            total.update(f"{path.relative_to(place).as_posix()}\0".encode() + path.read_bytes())
    return total.hexdigest()


def versions() -> dict[str, str]:
    """Return the versions of the loaded plugins; "unknown" for one that is not installed."""
    distributions = importlib.metadata.packages_distributions()
    known = {}
    for name in loaded:
        owners = distributions.get(name.partition(".")[0], [])
        known[name] = importlib.metadata.version(owners[0]) if owners else "unknown"
    return known


def _of_environment() -> list[str]:
    return [name.strip() for name in os.environ.get(VARIABLE, "").split(",") if name.strip()]


@functools.cache
def _installed() -> list[str]:
    return [point.module for point in importlib.metadata.entry_points(group=GROUP)]


def _imported(name: str) -> Path:
    here = str(Path.cwd())
    if here not in sys.path:  # unlike `python -m`, an installed command does not search the current folder
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
    """Return the folder of a plugin's package, with or without `__init__.py`, or a single module's file."""
    if folders := getattr(module, "__path__", None):
        return Path(next(iter(folders)))
    file = Path(module.__file__ or module.__name__)
    return file.parent if "." in module.__name__ else file
