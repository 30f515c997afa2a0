"""Launcher of programs: compose options by Hydra, report bad input in a line, call the program."""

import io
import os
import sys
from collections.abc import Callable, Sequence
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import Any

import yaml
from hydra import compose, initialize_config_dir
from hydra import main as hydra_main
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

import col3d.cli.resolvers  # noqa: F401  registers resolvers
from col3d.cli.again import Again
from col3d.cli.choices import as_groups, check_choices
from col3d.cli.files import CONF
from col3d.cli.overview import preflight
from col3d.cli.parts import load_plugins, offer_parts
from col3d.cli.paths import as_typed
from col3d.cli.refusals import explain, refuse
from col3d.errors import DataError, OptionError, RunLockedError, UserError
from col3d.io.json_files import write_json
from col3d.io.ownership import Owned
from col3d.io.run_files import STATUS, TRAINING, read_plain
from col3d.registry import DATASETS, GROUPS, plugins
from col3d.runs.overwriting import end

BAD_INPUT = (DataError, OptionError, UserError, OSError)
INTERRUPTED = 130
PLUGINS = "plugins"
TRAINS = ("train", "benchmark")
"""Programs whose options include all registered parts."""
SCRATCH = "search"
"""Group of values that a sweeper draws and others are computed from; no program takes it."""
Run = Callable[[dict[str, Any]], Any]


def launch(config_name: str, run: Run, words: Sequence[str]) -> None:
    """Compose `conf/<config_name>.yaml` with the command line and call `run` with plain values.

    Bad input ends in one line for each fault and exit code 2; any other exception keeps its traceback.

    Args:
        config_name: name of the program's configuration.
        run: function from plain options to the value that a sweeper optimises.
        words: the command line after the program's name.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # file names need not be UTF-8
    os.environ["HYDRA_FULL_ERROR"] = "1"  # Hydra raises exceptions instead of printing them
    typed = as_typed(list(words), config_name)
    try:
        typed = load_plugins(typed)
    except OptionError as error:
        refuse(str(error))
    offer_parts(GROUPS if config_name in TRAINS else DATASETS.groups if _has_data(config_name) else ())
    again = Again(sys.argv, config_name)
    arguments = [text for argument in typed for text in as_groups(argument)]
    sys.argv = [sys.argv[0], *arguments]  # Hydra reads it
    check_choices(arguments)

    def job(config: DictConfig) -> Any:
        try:
            given = OmegaConf.to_container(config, resolve=True, throw_on_missing=True)
            assert isinstance(given, dict)
            with again.as_single_job():
                return run(_plain(given, config_name))
        except RunLockedError as error:
            if HydraConfig.get().mode == RunMode.MULTIRUN:
                return print(f"left to its process: {error}", flush=True)
            refuse(explain(error, config_name))
        except (OmegaConfBaseException, *BAD_INPUT) as error:
            folder = Path(HydraConfig.get().runtime.output_dir)
            if HydraConfig.get().mode == RunMode.MULTIRUN:
                _note_failure(folder, explain(error, config_name))
                raise  # the sweep continues with its next jobs
            _drop_if_empty(folder)
            refuse(explain(error, config_name))

    try:
        sweep = preflight(config_name, arguments, again.command)
        hydra_main(version_base="1.3", config_path=str(CONF), config_name=config_name)(job)()
        if sweep is not None:
            end(sweep)
    except BrokenPipeError:  # the reader closed the pipe
        raise
    except (HydraException, OmegaConfBaseException, *BAD_INPUT) as error:
        refuse(explain(error, config_name))
    except KeyboardInterrupt:  # before the program handles signals
        sys.exit(INTERRUPTED)


def composed(program: str, overrides: Sequence[str] = ()) -> dict[str, Any]:
    """Compose the options of a program as plain values, as its command line does: for use from Python.

    Args:
        program: such as "train".
        overrides: such as "model=bts"; "plugins=[mylab]" imports that package. A training needs
            "output_dir=FOLDER".

    >>> composed("train", ["model=bts", "output_dir=runs/one"])["model"]["name"]
    'bts'
    """
    given = load_plugins([word for override in overrides for word in as_groups(override)])
    offer_parts()
    inside = GlobalHydra.instance().is_initialized()
    with nullcontext() if inside else initialize_config_dir(str(CONF), version_base="1.3"):
        config = compose(program, given)
    content = OmegaConf.to_container(config, resolve=True, throw_on_missing=True)
    assert isinstance(content, dict)
    return _plain(content, program)


def _has_data(config_name: str) -> bool:
    """Whether a program has the group `data`."""
    defaults = yaml.safe_load((CONF / f"{config_name}.yaml").read_text(encoding="utf-8"))["defaults"]
    return any("data" in entry for entry in defaults)


def _plain(content: dict[Any, Any], config_name: str) -> dict[str, Any]:
    """Return a program's own options; for programs that train, with the names of the loaded plugins."""
    options = {str(key): value for key, value in content.items() if key not in (SCRATCH, PLUGINS)}
    return {**options, PLUGINS: plugins.load()} if config_name in TRAINS else options


def _note_failure(folder: Path, reason: str) -> None:
    """Write the reason why a job of a sweep failed before it began; one that began has written it itself."""
    status, owned = read_plain(folder / STATUS), Owned(folder, TRAINING, "hydra.run.dir")
    with suppress(UserError):  # the folder holds files of others, which is the reason
        owned.check([STATUS])
        if not folder.is_dir() or status.get("state") == "failed":
            return
        owned.claim(STATUS)
        write_json(folder / STATUS, {**status, "state": "failed", "error": reason.splitlines()[-1]})


def _drop_if_empty(folder: Path) -> None:
    """Remove the empty folder of a job that never began."""
    with suppress(OSError):  # it is not empty, or not writable
        if folder != Path.cwd():
            folder.rmdir()
