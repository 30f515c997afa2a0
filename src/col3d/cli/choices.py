"""Choices of groups on the command line, checked before Hydra takes them in its own way."""

import re

from omegaconf import OmegaConf

from col3d.cli.files import CONF, is_group, names_in
from col3d.cli.refusals import refuse
from col3d.errors import nearest_name

TAKE_A_WORD = ("--config-dir", "-cd", "--config-path", "-cp", "--config-name", "-cn", "--package", "-p")
"""Hydra's own options after which a word follows."""
SEVERAL = ("protocol", "logger")
"""Groups of which several may be chosen."""
BEFORE = {f"logger.{option}": f"logger.wandb.{option}" for option in ("project", "offline")}
"""What options were called while there was one logger alone."""
OPEN = ("loss.terms.", "callbacks.more.", "metrics.")
ENTRY = re.compile(r"callbacks\.more\.[^.=]+=(?!null$)[^{\[=]+")
"""An entry by the name of its callback alone, whose options may be said, too."""
MAY_BE_NULL = [(group, "null") for group in ("experiment", "variant", "data")]


def check_choices(arguments: list[str]) -> None:
    """Refuse a group that is given a list or nothing: Hydra would take the last of a list without a word."""
    for argument in _overrides(arguments):
        group, _, choice = argument.partition("=")
        if is_group(group) and re.match(r"[\[\d]|(null|none)?$", choice):
            known = names_in(group)
            if (group, choice) not in MAY_BE_NULL and not (group in SEVERAL and choice.startswith("[")):
                refuse(
                    f"{group}: expected one of {', '.join(known)}, got {choice!r}; sweep with -m {group}=a,b"
                )


def _overrides(arguments: list[str]) -> list[str]:
    """All but the options that begin with a dash, and the words that belong to those."""
    before = ["", *arguments]
    return [
        argument
        for last, argument in zip(before, arguments, strict=False)
        if not argument.startswith("-") and last not in TAKE_A_WORD
    ]


def _is_of_trainer_alone(option: str) -> bool:
    """Whether only Lightning has it, not the configuration: the program says why."""
    group, _, name = option.partition(".")
    return group == "trainer" and bool(name) and name not in OmegaConf.load(CONF / "trainer" / "default.yaml")


def as_groups(argument: str) -> list[str]:
    """How Hydra wants said what its grammar has other words for: `data.test=simcol3d`, a term of a loss."""
    option, _, value = argument.partition("=")
    option = BEFORE.get(option, option)
    if option.startswith(OPEN) or _is_of_trainer_alone(option):  # mappings that are open to more
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
