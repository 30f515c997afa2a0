"""Every command of the README is read by the real parser, and runs, made small."""

import importlib.util
import re
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from test_launch import PROJECT, call
from tiny_run import SMALL, TINY, composed

from col3d.app.config import EvaluateOptions, PrepareOptions, TrainOptions, VerifyOptions
from col3d.app.errors import check_options
from launch.choices import as_groups

README = (PROJECT / "README.md").read_text(encoding="utf-8")
BASH = "\n".join(re.findall(r"```bash\n(.*?)```", README, flags=re.DOTALL))
COMMANDS = [shlex.split(line) for line in BASH.splitlines() if line.startswith("python ")]
MODULES = [command for command in COMMANDS if command[1] == "-m"]
COMMANDS = [command for command in COMMANDS if command[1] != "-m"]
OPTIONS = {
    "train.py": TrainOptions,
    "evaluate.py": EvaluateOptions,
    "prepare.py": PrepareOptions,
    "verify.py": VerifyOptions,
}
ELSEWHERE = ("data=", "hydra/launcher=")  # launchers have tests of their own
SHORT = [c for c in COMMANDS if c[1] == "train.py" and not any(a.startswith(ELSEWHERE) for a in c)]


def test_the_readme_names_targets_that_exist() -> None:
    makefile = (PROJECT / "Makefile").read_text(encoding="utf-8")
    for target in re.findall(r"^make (\w+)$", BASH, flags=re.MULTILINE):
        assert re.search(rf"^{target}:", makefile, flags=re.MULTILINE)


def test_every_command_is_one_of_ours() -> None:
    assert all(importlib.util.find_spec(command[2]) for command in MODULES)
    assert {command[1] for command in COMMANDS} == set(OPTIONS)
    assert len(COMMANDS) >= 9


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_every_command_composes(command: list[str]) -> None:
    script, arguments = command[1], [a for a in command[2:] if a != "-m"]
    if "-m" in command:
        swept = [re.sub(r"^([\w.]+)=([^\[\],]+),.*", r"\1=\2", argument) for argument in arguments]
        arguments = swept
    arguments = [text for argument in arguments for text in as_groups(argument)]
    given = composed(
        script.removesuffix(".py"), *arguments, *(["output_dir=x"] if script == "train.py" else [])
    )
    check_options(OPTIONS[script], given)


@pytest.mark.parametrize("command", SHORT, ids=" ".join)
def test_training_commands_run(command: list[str], phantom_root: Path, tmp_path: Path) -> None:
    place = [
        f"data.root={phantom_root}",
        f"hydra.run.dir={tmp_path}/run",
        f"hydra.sweep.dir={tmp_path}/sweep",
    ]
    encoder = [] if "model=newcrfs" in command else [SMALL]
    answer = call(*command[1:], *TINY, *encoder, *place, cwd=tmp_path)
    assert answer.returncode == 0, answer.stderr
    jobs = 4 if "-m" in command else 1
    assert len(list(tmp_path.rglob("summary.json"))) == jobs
    assert "all frames" in answer.stdout


def test_the_parts_work_as_shown() -> None:
    code = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)[0]
    lines = [line for line in code.splitlines() if "/path/to" not in line]
    names: dict[str, Any] = {}
    exec("\n".join(lines), names)
    assert names["normals"].shape == (1, 3, 320, 320)
    assert isinstance(names["normals_from_depth"], Callable)  # type: ignore[arg-type]
