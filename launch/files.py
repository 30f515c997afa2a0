"""The groups of the configuration: files, and registered parts."""

from contextlib import suppress
from pathlib import Path

from hydra.core.config_store import ConfigStore

CONF = Path(__file__).parents[1] / "conf"


def names_in(group: str) -> list[str]:
    """What a group of options offers."""
    stored: list[str] = []
    with suppress(OSError):  # what it raises where there is no such group
        stored = ConfigStore.instance().list(group)
    files = [*(CONF / group).glob("*.yaml"), *map(Path, stored)]
    return sorted({path.stem for path in files})


def is_group(name: str) -> bool:
    """Whether options of this name are chosen among several."""
    return bool(name) and ((CONF / name).is_dir() or bool(names_in(name)))
