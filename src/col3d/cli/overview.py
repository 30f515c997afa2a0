"""Checks of a whole command before any job runs: what Hydra would build, and the plan of a sweep."""

import argparse
import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from hydra import compose, initialize_config_dir
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.errors import HydraException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf, read_write
from omegaconf.errors import OmegaConfBaseException

from col3d.cli.files import CONF
from col3d.cli.searches import take_up
from col3d.cli.sweeps import jobs_of
from col3d.errors import UserError
from col3d.io.run_files import add_to_plan
from col3d.runs import provenance
from col3d.runs.overwriting import begin

BUILT_BY = ("_target_", "()", "class")
"""Keys whose value Hydra, or the logging configuration, imports and calls."""
SHORT = {
    "--help": ("-h",),
    "--shell-completion": ("-sc",),
    "--cfg": ("-c",),
    "--info": ("-i",),
    "--config-name": ("-cn",),
    "--config-dir": ("-cd",),
    "--config-path": ("-cp",),
    "--package": ("-p",),
}
"""Short forms of Hydra's flags."""
ALLOWED = (
    "hydra._internal.core_plugins.",
    "hydra.core.",
    "hydra_plugins.",
    "optuna.samplers.",
    "logging.",
    "colorlog.",
    "rich.logging.",
)
"""Prefixes of what the configuration may import and call."""


def preflight(config_name: str, arguments: Sequence[str], command: Sequence[str]) -> Path | None:
    """Refuse targets that must not be built, and write the jobs of a sweep into its folder, as its plan.

    Errors of composition are left to Hydra's own run, which reports them.

    Args:
        config_name: name of the program's configuration.
        arguments: its command line, as Hydra takes it.
        command: the words before the arguments.

    Returns:
        The folder of a sweep that overwrites its runs, else None; see `col3d.runs.overwriting`.

    Raises:
        UserError: the configuration or the command line names a target that may not be built.
    """
    flags, words = _flags(arguments)
    if flags.answers:
        return None
    try:
        overrides = OverridesParser.create().parse_overrides(words)
        config = _composed(flags.config_name or config_name, flags.config_dir, overrides)
    except (HydraException, OmegaConfBaseException, UserError):
        return None
    check_targets(config)
    if "LOCAL_RANK" not in os.environ and (flags.multirun or config.hydra.mode == RunMode.MULTIRUN):
        names = _plan(config.hydra, overrides, provenance.command([*command, *arguments]))
        take_up(config.hydra)
        if names and config.get("overwrite") is True:
            begin(Path(config.hydra.sweep.dir), names, "hydra.sweep.dir")
            return Path(config.hydra.sweep.dir)
    return None


def _flags(arguments: Sequence[str]) -> tuple[argparse.Namespace, list[str]]:
    """Parse Hydra's flags that matter here, and return them with the overrides."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    for flag in ("--help", "--hydra-help", "--version", "--shell-completion"):
        parser.add_argument(flag, *SHORT.get(flag, ()), dest="answers", action="store_true")
    for flag in ("--cfg", "--info"):
        parser.add_argument(flag, *SHORT.get(flag, ()), dest="answers", nargs="?", const="all")
    for flag in ("--config-name", "--config-dir", "--config-path", "--package"):
        parser.add_argument(flag, *SHORT.get(flag, ()))
    parser.add_argument("--multirun", "-m", action="store_true")
    flags, rest = parser.parse_known_args(list(arguments))
    return flags, [word for word in rest if not word.startswith("-")]


def check_targets(config: DictConfig) -> None:
    """Refuse targets that may not be built.

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
    """Compose the first job's configuration, including Hydra's own part."""
    first = [_first(override) for override in overrides]
    more = [] if folder is None else [f"hydra.searchpath=[file://{Path(folder).absolute()}]"]
    with initialize_config_dir(str(CONF), version_base="1.3"):
        return compose(config_name, [*more, *first], return_hydra_config=True)


def _first(override: Override) -> str:
    """Return an override, or the first choice of one that sweeps."""
    if override.is_sweep_override() and override.is_discrete_sweep():
        return f"{override.get_key_element()}={next(iter(override.sweep_string_iterator()))}"
    return str(override.input_line)


def _plan(hydra: DictConfig, overrides: Sequence[Override], command: str) -> list[str]:
    """Write the folders of a sweep's jobs and return them; an adaptive sweeper has no such plan."""
    if not str(hydra.sweeper._target_).endswith(".BasicSweeper"):
        return []
    parser, naming = OverridesParser.create(), hydra.job.config.override_dirname
    given = [override for override in overrides if not _is_hydras(override)]
    jobs = {}
    with read_write(hydra):
        for job in jobs_of(hydra.sweeper.params or {}, given):
            named = sorted(
                str(override.input_line)
                for override in parser.parse_overrides(job)
                if override.key_or_group not in naming.exclude_keys
            )
            hydra.job.override_dirname = re.sub("=", naming.kv_sep, naming.item_sep.join(named))
            jobs[str(hydra.sweep.subdir)] = job
    add_to_plan(Path(hydra.sweep.dir), jobs, command)
    return list(jobs)


def _is_hydras(override: Override) -> bool:
    return str(override.key_or_group).startswith(("hydra.", "hydra/"))
