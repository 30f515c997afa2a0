"""The jobs of a sweep."""

from collections.abc import Mapping, Sequence
from typing import Any

from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from omegaconf import OmegaConf

from col3d.checks import UserError, nearest_name
from launch.files import CONF

SWEPT = "hydra.sweeper.params"


def sweep_of(experiment: str, seeds: Sequence[int]) -> list[list[str]]:
    """The jobs of an experiment that sweeps, each as overrides, with other seeds than its file's.

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
    """The overrides of each job of Hydra's own sweeper, for its params and a command line."""
    swept = OverridesParser.create().parse_overrides([f"{name}={value}" for name, value in params.items()])
    batches = BasicSweeper.split_arguments([*swept, *given], None)
    return [list(job) for batch in batches for job in batch]


def given_overrides(besides: str) -> list[str]:
    """This program's overrides, but for those of one group of options."""
    return [text for text in HydraConfig.get().overrides.task if not text.lstrip("+~").startswith(besides)]
