"""The package that `docs/extending.md` makes trains, with all of its parts and nothing changed here."""

import shlex
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from pages import PROJECT, blocks, file_of
from programs import call
from refusals import refusal

pytestmark = pytest.mark.end_to_end

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
    "data.scale=32768",
    "data.split.train=[a]",
    "data.split.val=[b]",
    "data.split.test=[b]",
    "data.batch_size=2",
    "protocol=near",
    "metrics.bias.power=3",
    "optimizer=half",
    "scheduler=warm_up",
    "callbacks.more.count=counter",
    "preset=smoke",
    "trainer.max_epochs=1",
    "callbacks.panels=0",
)


@pytest.fixture
def lab(tmp_path: Path) -> Path:
    """A folder with the package in it."""
    for language in ("python", "yaml"):
        for block in blocks(PAGE, language):
            if name := file_of(block):
                path = tmp_path / name
                assert not path.exists()
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(block.split("\n", maxsplit=1)[1], encoding="utf-8")
    return tmp_path


def frames(root: Path) -> None:
    """A wall that recedes from 20 to 60 mm, as inverse depth."""
    mm = np.linspace(20, 60, 640)[None].repeat(480, axis=0)
    for place, video in enumerate("ab"):
        (root / video).mkdir(parents=True)
        for number in range(2):
            picture = np.full((480, 640, 3), 90 + 40 * number + 20 * place, np.uint8)
            cv2.imwrite(str(root / video / f"rgb_{number:04d}.png"), picture)
            cv2.imwrite(str(root / video / f"inverse_{number:04d}.png"), (32768 / mm).astype(np.uint16))


def test_the_package_trains_with_all_of_its_parts(lab: Path) -> None:
    frames(lab / "data")
    data = f"data.root={lab / 'data'}"
    prepared = call("prepare", "plugins=[mylab]", "data=disparity", data, "data.scale=32768", cwd=lab)
    assert prepared.returncode == 0, prepared.stderr
    verified = call("verify", "plugins=[mylab]", "data=disparity", data, "data.scale=32768", cwd=lab)
    assert verified.returncode == 0, verified.stdout + verified.stderr
    answer = call("train.py", *RUN, data, f"hydra.run.dir={lab / 'run'}", cwd=lab)
    assert answer.returncode == 0, answer.stderr
    assert "minimises 1 berhu(threshold=0.1) + 0.5 gradient_l1" in answer.stdout
    assert "Depth: unet on disparity, test split, seed 0, protocol near" in answer.stdout
    header = (lab / "run" / "per_frame.csv").read_text().splitlines()[0]
    assert "bias" in header.split(",")
    best = f"checkpoint={lab / 'run' / 'checkpoints' / 'best.ckpt'}"
    without = call("evaluate", best, cwd=lab)
    assert (without.returncode, without.stdout) == (2, "")
    assert "plugins=[mylab]" in refusal(without.stderr).message
    scored = call("evaluate", best, "plugins=[mylab]", "protocol=[near,standard]", "workers=0", cwd=lab)
    assert scored.returncode == 0, scored.stderr
    image = f"input={lab / 'data' / 'a' / 'rgb_0000.png'}"
    predicted = call("predict", best, "plugins=[mylab]", image, "output=out", "camera=disparity", cwd=lab)
    assert predicted.returncode == 0, predicted.stderr


def test_prepared_frames_of_another_scale_are_not_taken(lab: Path) -> None:
    frames(lab / "data")
    data, size = f"data.root={lab / 'data'}", "data.size=[64,80]"
    prepared = call("prepare", "plugins=[mylab]", "data=disparity", data, size, cwd=lab)
    assert prepared.returncode == 0, prepared.stderr
    answer = call("train.py", *RUN, data, size, f"hydra.run.dir={lab / 'run'}", cwd=lab)
    assert answer.returncode == 0, answer.stderr
    assert "does not serve: b was prepared otherwise" in answer.stdout


COMMANDS = [line for block in blocks(PAGE, "bash") for line in block.splitlines()]


@pytest.mark.parametrize("line", COMMANDS)
def test_every_command_of_the_page_composes(line: str, lab: Path) -> None:
    _, program, *words = shlex.split(line)
    composes = [] if program in ("list", "describe") else ["--cfg", "job"]
    answer = call(program, *words, *composes, cwd=lab)
    assert answer.returncode == 0, answer.stderr


def test_the_package_obeys_the_laws(lab: Path) -> None:
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:dash", "mylab/test_parts.py"]
    answer = subprocess.run(command, cwd=lab, capture_output=True, text=True, check=False)
    assert answer.returncode == 0, answer.stdout


def test_the_package_is_in_the_style_of_the_project(lab: Path) -> None:
    ruff = str(Path(sys.executable).with_name("ruff"))
    for command in (["check"], ["format", "--check"]):
        answer = subprocess.run(
            [ruff, *command, "--config", str(PROJECT / "pyproject.toml"), "mylab"],
            cwd=lab,
            capture_output=True,
            text=True,
            check=False,
        )
        assert answer.returncode == 0, answer.stdout
