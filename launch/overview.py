"""A look at a whole command before anything of it runs: what Hydra would build, and which jobs there are."""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from hydra import compose, initialize_config_dir
from hydra._internal.config_loader_impl import get_overrides_dirname
from hydra._internal.utils import get_args_parser
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.errors import HydraException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf, read_write
from omegaconf.errors import OmegaConfBaseException

from col3d.app.provenance import command
from col3d.app.replacing import begin
from col3d.checks import UserError
from col3d.reports.jobs import add_to_plan
from launch.files import CONF
from launch.searches import take_up
from launch.sweeps import jobs_of

BUILT_BY = ("_target_", "()", "class")
"""Keys whose value Hydra, or the configuration of logging, imports and calls."""
ALLOWED = (
    "hydra._internal.core_plugins.",
    "hydra.core.",
    "hydra_plugins.",
    "optuna.samplers.",
    "logging.",
    "colorlog.",
    "rich.logging.",
)


def look_over(config_name: str, arguments: Sequence[str]) -> Path | None:
    """Refuse what must not be built, and write the jobs of a sweep into its folder for the ledger.

    What cannot be composed is left to Hydra's own run, which says why.

    Returns:
        The folder of a sweep that overwrites its runs; see `col3d.app.replacing`.

    Raises:
        UserError: a file of the configuration, or the command line, asks for something else to be built.
    """
    given = get_args_parser().parse_args(arguments)
    if given.help or given.hydra_help or given.cfg or given.info or given.shell_completion:
        return None
    try:
        overrides = OverridesParser.create().parse_overrides(given.overrides)
        config = _composed(given.config_name or config_name, given.config_dir, overrides)
    except (HydraException, OmegaConfBaseException, UserError):
        return None
    check_targets(config)
    if "LOCAL_RANK" not in os.environ and (given.multirun or config.hydra.mode == RunMode.MULTIRUN):
        names = _plan(config.hydra, overrides)
        take_up(config.hydra)
        if names and config.get("overwrite") is True:
            begin(Path(config.hydra.sweep.dir), names, "hydra.sweep.dir")
            return Path(config.hydra.sweep.dir)
    return None


def check_targets(config: DictConfig) -> None:
    """Refuse what must not be built.

    Raises:
        UserError: names the option.
    """
    for option, target in _targets(OmegaConf.to_container(config, resolve=False)):
        if not target.startswith(ALLOWED):
            raise UserError(
                f"{option}: {target!r} is not built here; the configuration may name what comes from "
                f"{', '.join(name.rstrip('.') for name in ALLOWED)}"
            )


def _targets(node: Any, place: str = "") -> Iterator[tuple[str, str]]:
    if isinstance(node, list):
        node = dict(enumerate(node))
    if isinstance(node, dict):
        for key, value in node.items():
            inside = f"{place}.{key}".lstrip(".")
            if key in BUILT_BY and isinstance(value, str):
                yield inside, value
            yield from _targets(value, inside)


def _composed(config_name: str, folder: str | None, overrides: Sequence[Override]) -> DictConfig:
    """The first job's configuration, Hydra's own part included."""
    first = [_first(override) for override in overrides]
    more = [] if folder is None else [f"hydra.searchpath=[file://{Path(folder).absolute()}]"]
    with initialize_config_dir(str(CONF), version_base="1.3"):
        return compose(config_name, [*more, *first], return_hydra_config=True)


def _first(override: Override) -> str:
    """An override, or the first choice of one that sweeps."""
    if override.is_sweep_override() and override.is_discrete_sweep():
        return f"{override.get_key_element()}={next(iter(override.sweep_string_iterator()))}"
    return str(override.input_line)


def _plan(hydra: DictConfig, overrides: Sequence[Override]) -> list[str]:
    """Write which folders the jobs of a sweep will have; a sweeper that chooses as it goes has no plan."""
    if not str(hydra.sweeper._target_).endswith(".BasicSweeper"):
        return []
    parser, naming = OverridesParser.create(), hydra.job.config.override_dirname
    given = [override for override in overrides if not _is_hydras(override)]
    jobs = {}
    with read_write(hydra):
        for job in jobs_of(hydra.sweeper.params or {}, given):
            hydra.job.override_dirname = get_overrides_dirname(
                parser.parse_overrides(job), naming.exclude_keys, naming.item_sep, naming.kv_sep
            )
            jobs[str(hydra.sweep.subdir)] = job
    add_to_plan(Path(hydra.sweep.dir), jobs, command())
    return list(jobs)


def _is_hydras(override: Override) -> bool:
    return str(override.key_or_group).startswith(("hydra.", "hydra/"))
