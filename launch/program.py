"""The Hydra side of every entry point: compose, refuse bad input in a line, hand plain values on."""

import io
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from hydra import compose
from hydra import main as hydra_main
from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf, read_write
from omegaconf.errors import OmegaConfBaseException

from col3d import plugins
from col3d.app.replacing import end
from col3d.checks import DataError, OptionError, TakenError, UserError
from col3d.owned import Owned
from col3d.reports.jobs import STATUS, TRAINING, read_plain
from col3d.reports.summary import write_json
from launch.choices import as_groups, check_choices
from launch.files import CONF
from launch.overview import look_over
from launch.parts import load_plugins, store_parts
from launch.paths import as_typed, quoted_again
from launch.refusals import explain, refuse

BAD_INPUT = (DataError, UserError, OSError)
PROCESSES = ("LOCAL_RANK", "NODE_RANK", "WORLD_SIZE", "MASTER_ADDR", "MASTER_PORT")
"""What Lightning tells its other processes, and its own next Trainer."""
INTERRUPTED = 130
PLUGINS = "plugins"
TRAINS = ("train", "benchmark")
"""Programs whose options have registered parts among them."""
POLL_SECONDS = 1.0
SCRATCH = "search"
"""Values of a sweeper that others are computed from; no program takes them."""
Run = Callable[[dict[str, Any]], Any]


def launch(config_name: str, run: Run) -> None:
    """Compose `conf/<config_name>.yaml` with the command line and call `run` with plain values.

    Bad input ends in one line for each fault and exit code 2; any other exception keeps its traceback.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # names of files need not be UTF-8
    os.environ["HYDRA_FULL_ERROR"] = "1"  # Hydra hands exceptions on instead of printing them
    os.environ["PYTHONPATH"] = os.pathsep.join([str(CONF.parent), os.environ.get("PYTHONPATH", "")])
    typed = as_typed(sys.argv[1:], config_name)
    try:
        typed = load_plugins(typed)
    except OptionError as error:
        refuse(str(error))
    if config_name in TRAINS:
        store_parts()
    sys.argv[1:] = [text for argument in typed for text in as_groups(argument)]
    check_choices(sys.argv[1:])
    if {"--help", "-h", "--hydra-help"} & set(sys.argv[1:]):
        _look_once()

    def job(config: DictConfig) -> Any:
        try:
            given = OmegaConf.to_container(config, resolve=True, throw_on_missing=True)
            assert isinstance(given, dict)
            with _by_itself(config_name):
                return run(_plain(given, config_name))
        except TakenError as error:
            if HydraConfig.get().mode == RunMode.MULTIRUN:
                return print(f"left to its process: {error}", flush=True)
            refuse(explain(error, config_name))
        except (OmegaConfBaseException, *BAD_INPUT) as error:
            folder = Path(HydraConfig.get().runtime.output_dir)
            if HydraConfig.get().mode == RunMode.MULTIRUN:
                _note_failure(folder, explain(error, config_name))
                raise  # the jobs that follow are to run
            _drop_if_empty(folder)
            refuse(explain(error, config_name))

    try:
        sweep = look_over(config_name, sys.argv[1:])
        hydra_main(version_base="1.3", config_path=str(CONF), config_name=config_name)(job)()
        if sweep is not None:
            end(sweep)
    except (HydraException, OmegaConfBaseException, *BAD_INPUT) as error:
        refuse(explain(error, config_name))
    except KeyboardInterrupt:  # before a program of ours listens to it
        sys.exit(INTERRUPTED)


def _look_once() -> None:
    """Let Hydra's help copy its sources once, and not for each of its groups again, which takes a second."""
    made = ConfigLoaderImpl._parse_overrides_and_create_caching_repo
    known: dict[tuple[str | None, ...], Any] = {}

    def once(loader: ConfigLoaderImpl, config_name: str | None, overrides: list[str]) -> Any:
        place = (config_name, *overrides)
        if place not in known:
            known[place] = made(loader, config_name, overrides)
        return known[place]

    ConfigLoaderImpl._parse_overrides_and_create_caching_repo = once  # type: ignore[method-assign,assignment]


@contextmanager
def _by_itself(config_name: str) -> Iterator[None]:
    """Make a job of a sweep look as if it were called alone, which is how Lightning starts more processes."""
    hydra = HydraConfig.get()
    if str(hydra.launcher._target_).endswith(".JoblibLauncher"):
        threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    arguments, folder = sys.argv, hydra.runtime.output_dir
    before = {name: os.environ.get(name) for name in PROCESSES}
    if hydra.mode == RunMode.MULTIRUN:
        program = str(CONF.parent / f"{config_name}.py")
        sys.argv = [program, *quoted_again(hydra.overrides.task), "hydra.mode=RUN", f"hydra.run.dir={folder}"]
        with read_write(hydra.run):  # type: ignore[arg-type]
            hydra.run.dir = folder
    try:
        yield
    finally:
        sys.argv = arguments
        for name, value in before.items():
            os.environ.pop(name, None)
            if value is not None:
                os.environ[name] = value


def _end_with(launcher: int) -> None:
    """Ask a job to save and leave when the process that launched it is gone: joblib's workers outlive it."""
    while os.getppid() == launcher:
        time.sleep(POLL_SECONDS)
    os.kill(os.getpid(), signal.SIGTERM)


def composed(config_name: str, overrides: Sequence[str]) -> dict[str, Any]:
    """A configuration as plain values, inside a program that `launch` runs."""
    store_parts()
    content = OmegaConf.to_container(
        compose(config_name, list(overrides)), resolve=True, throw_on_missing=True
    )
    assert isinstance(content, dict)
    return _plain(content, config_name)


def _plain(content: dict[Any, Any], config_name: str) -> dict[str, Any]:
    """A program's own options, with the plugins that are loaded where a run is to remember them."""
    options = {str(key): value for key, value in content.items() if key not in (SCRATCH, PLUGINS)}
    return {**options, PLUGINS: plugins.load()} if config_name in TRAINS else options


def _note_failure(folder: Path, reason: str) -> None:
    """Say of a job of a sweep why it never began; one that began has said it itself."""
    said, owned = read_plain(folder / STATUS), Owned(folder, TRAINING, "hydra.run.dir")
    with suppress(UserError):  # a folder of others, which is why
        owned.check([STATUS])
        if not folder.is_dir() or said.get("state") == "failed":
            return
        owned.claim(STATUS)
        write_json(folder / STATUS, {**said, "state": "failed", "error": reason.splitlines()[-1]})


def _drop_if_empty(folder: Path) -> None:
    """Leave no folder behind for a job that never began."""
    with suppress(OSError):  # it holds something, or may not be written to
        if folder != Path.cwd():
            folder.rmdir()
