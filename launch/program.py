"""The Hydra side of every entry point: compose, refuse bad input in a line, hand plain values on."""

import hashlib
import os
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from hydra import compose, initialize_config_dir
from hydra import main as hydra_main
from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import InterpolationResolutionError, OmegaConfBaseException

from col3d.checks import DataError, UserError, nearest_name

CONF = Path(__file__).parent / "conf"
BAD_INPUT = (DataError, UserError, OSError)
EXIT_CODE = 2
LONGEST_NAME = 100
SWEPT = "hydra.sweeper.params"
MAY_BE_NULL = [(group, "null") for group in ("experiment", "variant", "data")]
Run = Callable[[dict[str, Any]], Any]


def slug(overrides: str) -> str:
    """A folder's name for the overrides of a job: readable, and unique where it had to be shortened."""
    name = re.sub(r"[^A-Za-z0-9._]+", "-", overrides.replace(",", "_")).strip("-") or "default"
    digest = hashlib.sha1(overrides.encode()).hexdigest()[:8]
    exact = re.fullmatch(r"[A-Za-z0-9._=/,]*", overrides) and len(name) <= LONGEST_NAME
    return name if exact else f"{name[:LONGEST_NAME]}-{digest}"


def by_scale(paper: Any, small: Any, *, _root_: DictConfig) -> Any:
    """What a model takes at preset=paper, and what at the smaller presets."""
    return paper if _root_.preset == "paper" else small


def size_of(preset: str | None, data: str) -> Any:
    """The size of frames at a preset; where none is named, at the one that the data set is mostly for."""
    path = CONF / "preset" / f"{preset or ('laptop' if data == 'phantom' else 'paper')}.yaml"
    if not path.is_file():
        known = sorted(path.stem for path in path.parent.glob("*.yaml"))
        raise UserError(f"prepare.preset: expected one of {', '.join(known)}, got {preset!r}")
    return OmegaConf.select(OmegaConf.load(path), "data.size")


OmegaConf.register_new_resolver("size_of", size_of, replace=True)
OmegaConf.register_new_resolver("slug", slug, replace=True)
OmegaConf.register_new_resolver("by_scale", by_scale, replace=True)


def launch(config_name: str, run: Run) -> None:
    """Compose `conf/<config_name>.yaml` with the command line and call `run` with plain values.

    Bad input ends in one line for each fault and exit code 2; any other exception keeps its traceback.
    """
    os.environ["HYDRA_FULL_ERROR"] = "1"  # Hydra hands exceptions on instead of printing them
    sys.argv[1:] = [text for argument in sys.argv[1:] for text in _as_groups(argument)]
    _check_choices(sys.argv[1:])

    def job(config: DictConfig) -> Any:
        try:
            given = OmegaConf.to_container(config, resolve=True, throw_on_missing=True)
            assert isinstance(given, dict)
            return run({str(key): value for key, value in given.items()})
        except (OmegaConfBaseException, *BAD_INPUT) as error:
            _drop_if_empty(Path(HydraConfig.get().runtime.output_dir))
            if HydraConfig.get().mode == RunMode.MULTIRUN:
                raise  # the jobs that follow are to run
            _refuse(_explain(error, config_name))

    try:
        hydra_main(version_base="1.3", config_path=str(CONF), config_name=config_name)(job)()
    except (HydraException, OmegaConfBaseException, *BAD_INPUT) as error:
        _refuse(_explain(error, config_name))


def sweep_of(experiment: str, seeds: Sequence[int]) -> list[list[str]]:
    """The jobs of an experiment that sweeps, each as overrides, with other seeds than its file's.

    Raises:
        UserError: there is no such experiment, or it sweeps over nothing.
    """
    files = {path.stem: path for path in (CONF / "experiment").glob("*.yaml")}
    sweeping = {name: OmegaConf.select(OmegaConf.load(path), SWEPT) for name, path in files.items()}
    known = [name for name, params in sorted(sweeping.items()) if params]
    if experiment not in known:
        raise UserError(
            f"benchmark.experiments: expected some of {', '.join(known)}, got {experiment!r}"
            f"{nearest_name(experiment, known)}"
        )
    params = {**sweeping[experiment], "seed": ",".join(map(str, seeds))}
    parsed = OverridesParser.create().parse_overrides([f"{name}={value}" for name, value in params.items()])
    batches = BasicSweeper.split_arguments(parsed, None)
    return [list(job) for batch in batches for job in batch]


def given_overrides(besides: str) -> list[str]:
    """This program's overrides, but for those of one group of options."""
    return [text for text in HydraConfig.get().overrides.task if not text.lstrip("+~").startswith(besides)]


def composed(config_name: str, overrides: Sequence[str]) -> dict[str, Any]:
    """A configuration as plain values, inside a program that `launch` runs."""
    content = OmegaConf.to_container(
        compose(config_name, list(overrides)), resolve=True, throw_on_missing=True
    )
    assert isinstance(content, dict)
    return {str(key): value for key, value in content.items()}


def _check_choices(arguments: list[str]) -> None:
    """Refuse a group that is given a list or nothing: Hydra would take the last of a list without a word."""
    for argument in arguments:
        group, _, choice = argument.partition("=")
        if (CONF / group).is_dir() and group and re.match(r"[\[\d]|(null|none)?$", choice):
            known = sorted(path.stem for path in (CONF / group).glob("*.yaml"))
            if (group, choice) not in MAY_BE_NULL and not (group == "protocol" and choice.startswith("[")):
                _refuse(
                    f"{group}: expected one of {', '.join(known)}, got {choice!r}; sweep with -m {group}=a,b"
                )


def _as_groups(argument: str) -> list[str]:
    """How Hydra wants a choice inside `data` said: `data.test=simcol3d`, `data.also=[simcol3d,c3vdv2]`."""
    option, _, value = argument.partition("=")
    names = value.strip("[]").split(",")
    if option == "data.split" and (CONF / "data/split" / f"{value}.yaml").is_file():
        return [f"data/split={value}"]
    if option not in ("data.test", "data.also") or value in ("null", "{}"):
        return [argument]
    known = sorted(path.stem for path in (CONF / "data/source").glob("*.yaml"))
    for name in names:
        if name not in known:
            _refuse(f"{option}: expected one of {', '.join(known)}, got {name!r}{nearest_name(name, known)}")
    if option == "data.test" and value.startswith("["):
        _refuse(f"data.test: expected one of {', '.join(known)}, got {value}")
    if option == "data.test":
        return [f"+data/source@data.test={value}"]
    return [f"+data/source@data.also.{name}={name}" for name in names]


def _drop_if_empty(folder: Path) -> None:
    """Leave no folder behind for a job that never began."""
    if folder != Path.cwd() and folder.is_dir() and not any(folder.iterdir()):
        folder.rmdir()


def _refuse(message: str) -> None:
    print("\n".join(f"error: {line}" for line in message.splitlines()), file=sys.stderr)
    sys.exit(EXIT_CODE)


def _explain(error: Exception, config_name: str) -> str:
    """Hydra's complaint about the command line as one line, with the nearest valid name."""
    if isinstance(error, OSError) and not isinstance(error, HydraException):  # some of Hydra's are both
        return f"{error.filename or 'file'}: {error.strerror or error}"
    while isinstance(error, InterpolationResolutionError) and isinstance(error.__context__, Exception):
        error = error.__context__  # what one of the resolvers says
    if isinstance(error, DataError | UserError):
        return str(error).rpartition("DataError: ")[2].strip()  # a loader's worker sends its traceback along
    text = " ".join(f"{error} {error.__cause__ or ''}".split())
    for pattern, explanation in COMPLAINTS.items():
        if found := re.search(pattern, text):
            return explanation(found.group(1), config_name)
    return text


def _unknown_option(option: str, config_name: str) -> str:
    return f"{option}: no such option{nearest_name(option, _options(config_name))}"


def _unknown_choice(choice: str, config_name: str) -> str:
    group, _, name = choice.rpartition("/")
    known = sorted(path.stem for path in (CONF / group).glob("*.yaml"))
    return f"{group}: {name!r} is unknown{nearest_name(name, known)} Known: {', '.join(known)}"


def _missing_value(option: str, config_name: str) -> str:
    return f"{option}: a value is needed; give {option}=..."


def _bare_list(option: str, config_name: str) -> str:
    brackets = "" if (CONF / option).is_dir() else "write a list in brackets, [0.5,0.3,0.2], or "
    return f"{option}: {brackets}sweep over the values with -m"


def _unreadable(override: str, config_name: str) -> str:
    return f"{override}: not key=value; write lists without spaces, such as loss.lambdas=[0.5,0.3,0.2]"


COMPLAINTS: dict[str, Callable[[str, str], str]] = {
    r"Could not override '([^']+)'": _unknown_option,
    r"Could not find '([^']+)'": _unknown_choice,
    r"Missing mandatory value.*full_key: (\S+)": _missing_value,
    r"Ambiguous value for argument '([^=]+)=": _bare_list,
    r"(?:no viable alternative|mismatched|extraneous|token).*?'([^']*)'": _unreadable,
}


def _options(config_name: str) -> list[str]:
    """Every option of the configuration, dotted."""
    with initialize_config_dir(str(CONF), version_base="1.3"):
        config = OmegaConf.to_container(compose(config_name), resolve=False)
    return _dotted(config) + ["experiment"] * (config_name == "train")


def _dotted(node: Any, prefix: str = "") -> list[str]:
    if not isinstance(node, dict):
        return [prefix]
    inside = [name for key, value in node.items() for name in _dotted(value, f"{prefix}.{key}".strip("."))]
    return [prefix, *inside] if prefix else inside
