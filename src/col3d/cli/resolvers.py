"""OmegaConf resolvers: functions that `${...}` can call in the configuration."""

import hashlib
import re
from collections.abc import Mapping
from typing import Any

from omegaconf import DictConfig, ListConfig, OmegaConf

from col3d.cli.files import CONF, names_in
from col3d.errors import UserError
from col3d.registry import DATASETS

LONGEST_NAME = 100
DRAWABLE = 4
"""Number of a phantom's parts that can be randomised."""


def slug(overrides: str) -> str:
    """Make a folder name of a job's overrides: readable, with a hash where it was shortened or changed."""
    name = re.sub(r"[^A-Za-z0-9._]+", "-", overrides.replace(",", "_")).strip("-") or "default"
    digest = hashlib.sha1(overrides.encode()).hexdigest()[:8]
    exact = re.fullmatch(r"[A-Za-z0-9._=/,]*", overrides) and len(name) <= LONGEST_NAME
    return name if exact else f"{name[:LONGEST_NAME]}-{digest}"


def by_preset(special: Mapping[str, Any], usual: Any, *, _root_: DictConfig) -> Any:
    """Return a value that depends on the preset: `${by_preset:{paper:512,smoke:64},128}`."""
    return special.get(str(_root_.preset), usual)


def size_of(preset: str | None, data: str) -> Any:
    """Return the frame size at a preset; if none is named, `laptop` for rendered data, else `paper`."""
    path = CONF / "preset" / f"{preset or ('laptop' if DATASETS[data].facts['rendered'] else 'paper')}.yaml"
    if not path.is_file():
        known = names_in("preset")
        raise UserError(f"prepare.preset: expected one of {', '.join(known)}, got {preset!r}")
    return OmegaConf.select(OmegaConf.load(path), "data.size")


def colons(*bounds: Any) -> list[str]:
    """Names of a phantom's videos with their seeds, for each pair of a first and a last number."""
    from col3d.data.datasets.videos import seeded_videos

    pairs = list(zip(bounds[::2], bounds[1::2], strict=False))
    whole = all(type(bound) is int for bound in bounds) and len(bounds) % 2 == 0
    if not (whole and pairs and all(0 <= first <= last for first, last in pairs)):
        given = ",".join(map(str, bounds))
        raise UserError(
            f"${{colons:{given}}}: expected a first and a last number from 0, or several such pairs"
        )
    return [name for first, last in pairs for name in seeded_videos(first, last)]


def without(kind: str, value: Any, part: str) -> list[str]:
    """Return a part of the split that leaves out a segment or texture: `${leave_out:segment,cecum,train}`."""
    from col3d.data.splits import leave_out

    return leave_out(kind, str(value))[part]


def drawn(randomise: Any) -> str:
    """Return the suffix of a phantom's folder name for the parts that its videos randomise."""
    if not isinstance(randomise, bool | ListConfig):
        raise UserError(f"data.randomise: expected true, false or a list of parts, got {randomise!r}")
    if isinstance(randomise, bool):
        return "_randomised" if randomise else ""
    parts = sorted({str(part) for part in randomise})
    return "_randomised" if len(parts) == DRAWABLE else "".join(f"_{part}" for part in parts)


OmegaConf.register_new_resolver("colons", colons, replace=True)
OmegaConf.register_new_resolver("drawn", drawn, replace=True)
OmegaConf.register_new_resolver("leave_out", without, replace=True)
OmegaConf.register_new_resolver("size_of", size_of, replace=True)
OmegaConf.register_new_resolver("slug", slug, replace=True)
OmegaConf.register_new_resolver("by_preset", by_preset, replace=True)
