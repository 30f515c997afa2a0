"""The groups of the configuration: files of this package and of plugins, and registered parts."""

from pathlib import Path

from col3d import plugins
from col3d.registry import KINDS

CONF = Path(__file__).parents[1] / "conf"


def names_in(group: str) -> list[str]:
    """What a group of options offers."""
    folders = [CONF, *plugins.configurations()]
    files = {path.stem for folder in folders for path in (folder / group).glob("*.yaml")}
    return sorted({*files, *(KINDS[group].names() if is_kind(group) else ())})


def is_group(name: str) -> bool:
    """Whether options of this name are chosen among several."""
    return bool(name) and (is_kind(name) or (CONF / name).is_dir() or bool(names_in(name)))


def is_kind(group: str) -> bool:
    """Whether registered parts are among its choices."""
    return group in KINDS and KINDS[group].node is not None
