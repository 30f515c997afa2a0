"""Every command of the README and of the pages in docs/ is read by the real parser, and runs, made small."""

import importlib.util
import re
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pages import PAGES, PROJECT, blocks, file_of
from programs import call
from tiny_run import SMALL, TINY, composed

from col3d.cli.choices import as_groups
from col3d.cli.main import PROGRAMS, main
from col3d.cli.programs import RUNS
from col3d.data.cache.options import PrepareOptions
from col3d.data.checks.options import VerifyOptions
from col3d.data.download.options import DownloadOptions
from col3d.evaluation.options import EvaluateOptions
from col3d.inference.options import ExportOptions, FuseOptions, PredictOptions
from col3d.registry.refusals import check_options
from col3d.training.options import TrainOptions
from col3d.training.trial import WENT_THROUGH

pytestmark = pytest.mark.end_to_end

LINES = list(
    dict.fromkeys(line for page in PAGES for block in blocks(page, "bash") for line in block.splitlines())
)
"""Every line of bash, once."""
OWN_PARTS = "plugins=[mylab]"
"""Of a package that `tests/docs/test_extending.py` makes from its page."""
CALL = re.compile(r"^(?:[A-Z0-9_]+=\S+ )?(?:\.venv/bin/)?(?:python|col3d) ")
COMMANDS = [["", *shlex.split(CALL.sub("", line))] for line in LINES if CALL.match(line)]
MODULES = [command for command in COMMANDS if command[1] == "-m"]
WORDS = [command for command in COMMANDS if command[1] in PROGRAMS.keys() - RUNS.keys()]
"""Programs that take no options."""
COMMANDS = [c for c in COMMANDS if c not in (*MODULES, *WORDS) and OWN_PARTS not in c]
PYTHON = {page: [block for block in blocks(page, "python") if not file_of(block)] for page in PAGES}
"""Blocks to run; those that are files are done by `tests/docs/test_extending.py`."""
OPTIONS = {
    "train.py": TrainOptions,
    "train": TrainOptions,
    "evaluate": EvaluateOptions,
    "predict": PredictOptions,
    "fuse": FuseOptions,
    "export": ExportOptions,
    "prepare": PrepareOptions,
    "verify": VerifyOptions,
    "download": DownloadOptions,
}
ELSEWHERE = ("data=", "hydra/launcher=", "init.checkpoint=")  # they have tests of their own
SHORT = [c for c in COMMANDS if c[1].startswith("train") and not any(a.startswith(ELSEWHERE) for a in c)]
SHORT = [
    c for c in SHORT if not any(a.startswith("hydra.sweep.dir=") for a in c)
]  # another place, the same runs


def test_every_line_is_a_command_of_ours() -> None:
    makefile = (PROJECT / "Makefile").read_text(encoding="utf-8")
    for line in LINES:
        if target := re.match(r"make ([\w-]+)", line):
            assert re.search(rf"^{target[1]}:", makefile, flags=re.MULTILINE), line
        else:
            assert CALL.match(line) or line == "source .venv/bin/activate", line


@pytest.mark.parametrize("command", [c for c in WORDS if "plugins=[mylab]" not in c], ids=" ".join)
def test_words_are_understood(command: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    if command[1] == "report":
        return  # its arguments are folders of runs; `test_benchmark.py` writes one
    assert main(command[1:]) == 0
    assert capsys.readouterr().out


def test_every_command_is_one_of_ours() -> None:
    assert all(importlib.util.find_spec(command[2]) for command in MODULES)
    named = [argument for command in MODULES for argument in command if argument.endswith(".py")]
    assert all((PROJECT / name).is_file() for name in named)
    assert {command[1] for command in COMMANDS} <= set(OPTIONS)
    assert len(COMMANDS) >= 25


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_every_command_composes(command: list[str]) -> None:
    script, arguments = command[1], [a for a in command[2:] if a != "-m"]
    if "-m" in command:
        swept = [re.sub(r"^([\w.]+)=([^\[\],]+),.*", r"\1=\2", argument) for argument in arguments]
        arguments = swept
    arguments = [text for argument in arguments for text in as_groups(argument)]
    given = composed(
        script.removesuffix(".py"), *arguments, *(["output_dir=x"] if script.startswith("train") else [])
    )
    check_options(OPTIONS[script], given)


@pytest.mark.parametrize("command", SHORT, ids=" ".join)
def test_training_commands_run(command: list[str], phantom_root: Path, tmp_path: Path) -> None:
    drawing = any("sim2real" in word for word in command)
    place = [
        *([] if drawing else [f"data.root={phantom_root}"]),
        f"hydra.run.dir={tmp_path}/run",
        f"hydra.sweep.dir={tmp_path}/sweep",
    ]
    encoder = [] if "model=newcrfs" in command else [SMALL]
    longer = ["trainer.max_epochs=2"] if any("check_val_every_n_epoch" in word for word in command) else []
    answer = call(*command[1:], *TINY, *longer, *encoder, *place, cwd=tmp_path)
    assert answer.returncode == 0, answer.stderr
    if "trainer.fast_dev_run=true" in command:
        assert WENT_THROUGH in answer.stdout
        return
    jobs = 5 if "experiment=sim2real_ablation" in command else 4 if "-m" in command else 1
    assert len(list(tmp_path.rglob("summary.json"))) == jobs
    assert "all frames" in answer.stdout


@pytest.mark.parametrize("page", [page for page in PAGES if PYTHON[page]], ids=lambda page: page.stem)
def test_python_works_as_shown(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    lines = [line for block in PYTHON[page] for line in block.splitlines() if "/path/to" not in line]
    names: dict[str, Any] = {}
    exec("\n".join(lines), names)
    if page.stem == "concepts":
        assert names["normals"].shape == (1, 3, 320, 320)
        assert isinstance(names["normals_from_depth"], Callable)  # type: ignore[arg-type]
        assert names["values"]["abs_rel"].tolist() == pytest.approx([0.1, 0.1])
