"""The folder of the configuration."""

from pathlib import Path

CONF = Path(__file__).parents[1] / "conf"


def names_in(group: str) -> list[str]:
    """What a group of options offers."""
    return sorted(path.stem for path in (CONF / group).glob("*.yaml"))
