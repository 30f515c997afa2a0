"""The steps of `docs/extending.md` make a network, a loss, a data set and a protocol."""

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from pages import PROJECT, blocks, file_of

PAGE = PROJECT / "docs" / "extending.md"
RUN = (
    "plugins=[mylab]",
    "model=unet",
    "model.dropout=0.2",
    "loss.terms.depth.term=berhu",
    "loss.terms.depth.threshold=0.1",
    "loss.terms.edges=gradient_l1",
    "loss.lambdas=[1.0,0.5]",
    "data=disparity",
    "data.split.train=[a]",
    "data.split.val=[b]",
    "data.split.test=[b]",
    "data.batch_size=2",
    "protocol=near",
    "preset=smoke",
    "trainer.max_epochs=1",
    "callbacks.panels=0",
)


def changed(text: str, diff: str) -> str:
    """The text with the lines of a diff replaced, which are in it once."""
    lines = [(line[:1], line[1:]) for line in diff.splitlines(keepends=True)]
    before = "".join(line for sign, line in lines if sign in " -")
    assert text.count(before) == 1, f"not there once:\n{before}"
    return text.replace(before, "".join(line for sign, line in lines if sign in " +"))


@pytest.fixture
def extended(tmp_path: Path) -> Path:
    project = tmp_path / "project"
    for folder in ("src",):
        shutil.copytree(PROJECT / folder, project / folder, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(PROJECT / "train.py", project)
    for language in ("python", "yaml", "diff"):
        for block in blocks(PAGE, language):
            name = file_of(block)
            assert name is not None, block
            content, path = block.split("\n", maxsplit=1)[1], project / name
            if language == "diff":
                content = changed(path.read_text(encoding="utf-8"), content)
            else:
                assert not path.exists()
            path.parent.mkdir(exist_ok=True)
            path.write_text(content, encoding="utf-8")
    return project


def frames(root: Path) -> None:
    """A wall that recedes from 20 to 60 mm, as inverse depth."""
    mm = np.linspace(20, 60, 640)[None].repeat(480, axis=0)
    for video in "ab":
        (root / video).mkdir(parents=True)
        for number in range(2):
            picture = np.full((480, 640, 3), 90 + 40 * number, np.uint8)
            cv2.imwrite(str(root / video / f"rgb_{number:04d}.png"), picture)
            cv2.imwrite(str(root / video / f"inverse_{number:04d}.png"), (65535 / mm).astype(np.uint16))


def call(project: Path, *command: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(project / "src"), "OMP_NUM_THREADS": "1"}
    command = (sys.executable, *command)
    return subprocess.run(command, cwd=project, env=environment, capture_output=True, text=True, check=False)


def test_the_worked_steps_train(extended: Path, tmp_path: Path) -> None:
    frames(tmp_path / "data")
    place = [f"data.root={tmp_path / 'data'}", f"hydra.run.dir={tmp_path / 'run'}"]
    answer = call(extended, "train.py", *RUN, *place)
    assert answer.returncode == 0, answer.stderr
    assert "minimises 1 berhu(threshold=0.1) + 0.5 gradient_l1" in answer.stdout
    assert "Depth: unet on disparity, test split, seed 0, protocol near" in answer.stdout


COMMANDS = [line for block in blocks(PAGE, "bash") for line in block.splitlines()]


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_of_the_page_composes(command: str, extended: Path) -> None:
    answer = call(extended, *shlex.split(command)[1:], "--cfg", "job")
    assert answer.returncode == 0, answer.stderr
    assert "name: unet" in answer.stdout


def test_the_worked_steps_are_in_the_style_of_the_project(extended: Path) -> None:
    named = {
        name
        for language in ("python", "diff")
        for block in blocks(PAGE, language)
        if (name := file_of(block))
    }
    ruff = str(Path(sys.executable).with_name("ruff"))
    for command in (["check"], ["format", "--check"]):
        answer = subprocess.run(
            [ruff, *command, "--config", str(PROJECT / "pyproject.toml"), *sorted(named)],
            cwd=extended,
            capture_output=True,
            text=True,
            check=False,
        )
        assert answer.returncode == 0, answer.stdout
