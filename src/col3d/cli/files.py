"""Choices in the configuration's groups: files of this package and of plugins, and registered parts."""

from pathlib import Path

from col3d.registry import GROUPS, plugins

CONF = Path(__file__).parents[1] / "conf"


def names_in(group: str) -> list[str]:
    """List the choices of a group."""
    folders = [CONF, *plugins.configurations()]
    files = {path.stem for folder in folders for path in (folder / group).glob("*.yaml")}
    return sorted({*files, *(GROUPS[group].names() if group in GROUPS else ())})


def is_group(name: str) -> bool:
    """Whether a name is that of a group, whose value is a choice."""
    return bool(name) and (name in GROUPS or (CONF / name).is_dir() or bool(names_in(name)))
