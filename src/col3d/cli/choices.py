"""Choices of configuration groups on the command line: checks, and conversion to Hydra's grammar."""

import re

from omegaconf import OmegaConf

from col3d.cli.files import CONF, is_group, names_in
from col3d.cli.refusals import refuse
from col3d.nearest_names import nearest_name

TAKE_A_WORD = ("--config-dir", "-cd", "--config-path", "-cp", "--config-name", "-cn", "--package", "-p")
"""Hydra's own flags that take an argument."""
SEVERAL = ("protocol", "logger")
"""Groups in which several choices may be combined."""
BEFORE = {f"logger.{option}": f"logger.wandb.{option}" for option in ("project", "offline")}
"""Short names of options, and the options that they stand for."""
OPEN = ("loss.terms.", "callbacks.more.", "metrics.")
ENTRY = re.compile(r"callbacks\.more\.[^.=]+=(?!null$)[^{\[=]+")
"""An entry given only by the name of its callback; its options may follow."""
MAY_BE_NULL = [(group, "null") for group in ("experiment", "variant", "data")]


def check_choices(arguments: list[str]) -> None:
    """Refuse a list or an empty value for a group: Hydra would silently take the last choice of a list."""
    for argument in _overrides(arguments):
        group, _, choice = argument.partition("=")
        if is_group(group) and re.match(r"[\[\d]|(null|none)?$", choice):
            known = names_in(group)
            if (group, choice) not in MAY_BE_NULL and not (group in SEVERAL and choice.startswith("[")):
                refuse(
                    f"{group}: expected one of {', '.join(known)}, got {choice!r}; sweep with -m {group}=a,b"
                )


def _overrides(arguments: list[str]) -> list[str]:
    """Return the arguments without flags, which begin with a dash, and their values."""
    before = ["", *arguments]
    return [
        argument
        for last, argument in zip(before, arguments, strict=False)
        if not argument.startswith("-") and last not in TAKE_A_WORD
    ]


def _is_of_trainer_alone(option: str) -> bool:
    """Whether the configuration lacks an option of `trainer`; the program explains why it is not taken."""
    group, _, name = option.partition(".")
    return group == "trainer" and bool(name) and name not in OmegaConf.load(CONF / "trainer" / "default.yaml")


def as_groups(argument: str) -> list[str]:
    """Convert an argument to Hydra's grammar, such as `data.test=simcol3d` or a term of a loss."""
    option, _, value = argument.partition("=")
    option = BEFORE.get(option, option)
    if option.startswith(OPEN) or _is_of_trainer_alone(option):  # mappings that take new keys
        return [f"++{option}.callback={value}" if ENTRY.fullmatch(argument) else f"++{argument}"]
    names = value.strip("[]").split(",")
    if option == "data.split" and (CONF / "data/split" / f"{value}.yaml").is_file():
        return [f"data/split={value}"]
    if option not in ("data.test", "data.also") or value in ("null", "{}"):
        return [f"{option}={value}" if option in BEFORE.values() else argument]
    known = names_in("data/source")
    for name in names:
        if name not in known:
            refuse(f"{option}: expected one of {', '.join(known)}, got {name!r}{nearest_name(name, known)}")
    if option == "data.test" and value.startswith("["):
        refuse(f"data.test: expected one of {', '.join(known)}, got {value}")
    if option == "data.test":
        return [f"+data/source@data.test={value}"]
    return [f"+data/source@data.also.{name}={name}" for name in names]
