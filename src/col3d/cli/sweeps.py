"""Expansion of a sweep into the overrides of its jobs."""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from omegaconf import OmegaConf

from col3d.cli.files import CONF
from col3d.errors import UserError
from col3d.nearest_names import nearest_name

SWEPT = "hydra.sweeper.params"


def sweep_of(experiment: str, seeds: Sequence[int]) -> list[list[str]]:
    """Return the jobs of an experiment that sweeps, each as overrides, with the given seeds.

    Raises:
        UserError: there is no such experiment, or it sweeps over nothing.
    """
    files = {path.stem: OmegaConf.load(path) for path in (CONF / "experiment").glob("*.yaml")}
    sweeping = {
        name: OmegaConf.select(content, SWEPT) for name, content in files.items() if set(content) == {"hydra"}
    }
    known = [name for name, params in sorted(sweeping.items()) if params]
    if experiment not in known:
        raise UserError(
            f"benchmark.experiments: expected some of {', '.join(known)}, got {experiment!r}"
            f"{nearest_name(experiment, known)}"
        )
    return jobs_of({**sweeping[experiment], "seed": ",".join(map(str, seeds))})


def jobs_of(params: Mapping[str, Any], given: Sequence[Override] = ()) -> list[list[str]]:
    """Return the overrides of each job of Hydra's basic sweeper, for its params and a command line."""
    swept = OverridesParser.create().parse_overrides([f"{name}={value}" for name, value in params.items()])
    choices = {override.get_key_element(): _choices(override) for override in (*swept, *given)}
    return [list(job) for job in itertools.product(*choices.values())]


def _choices(override: Override) -> list[str]:
    """Return an override for each value that an override sweeps over, or itself."""
    name = override.get_key_element()
    if not override.is_sweep_override():
        return [f"{name}={override.get_value_element_as_str()}"]
    if not override.is_discrete_sweep():
        raise UserError(
            f"{name}: an interval needs a sweeper that draws from it, such as hydra/sweeper=optuna"
        )
    return [f"{name}={value}" for value in override.sweep_string_iterator()]


def given_overrides(besides: str) -> list[str]:
    """Return this program's overrides, without those of one group of options."""
    return [text for text in HydraConfig.get().overrides.task if not text.lstrip("+~").startswith(besides)]
