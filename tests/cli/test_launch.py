"""The command as a user calls it: exit codes and what is printed."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from programs import call
from refusals import refusal

from col3d.cli.programs import RUNS
from col3d.cli.resolvers import slug

pytestmark = pytest.mark.end_to_end


@pytest.mark.parametrize(
    ("arguments", "about", "named"),
    [
        (["loss.lambda=[1,1,1]"], "loss.lambda", ["'loss.lambdas'"]),
        (["modle=bts"], "modle", ["'model'"]),
        (["model=bst"], "model", ["'bst'", "'bts'", "col3d_mtl"]),
        (["loss.lambdas=0.5,0.3,0.2"], "loss.lambdas", ["[0.5,0.3,0.2]", "-m"]),
        (["loss.lambdas=[0.5,", "0.3]"], "loss.lambdas", ["spaces", "got [0.5,"]),
        (["data=c3vd"], "data.root", ["data.root=..."]),
        (["model=bts,col3d_mtl"], "model", ["-m"]),
        (["model=[bts,col3d_mtl]"], "model", ["bts, ", "-m"]),
        (["loss=null"], "loss", ["monodepth_fpn, mtl", "null"]),
        (["trainer.accelerator=cuda"], "trainer.accelerator", ["cuda"]),
        (["hydra.run.dir=/proc/nowhere"], "/proc/nowhere", []),
        (["trainer.devices=0"], "trainer.devices", []),
        (["loss.lambdas=[0.5,0.3]"], "loss.lambdas", ["3 number(s)"]),
        (["data=c3vd", "data.root=nowhere"], "data.root={folder}/nowhere", ["no such folder"]),
    ],
)
def test_bad_input_ends_in_one_line_and_exit_code_2(
    arguments: list[str], about: str, named: list[str], tmp_path: Path
) -> None:
    answer = call("train.py", *arguments, cwd=tmp_path)
    assert answer.returncode == 2, answer.stderr
    assert refusal(answer.stderr).about == about.format(folder=tmp_path)
    for part in named:
        assert part in answer.stderr
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_a_missing_checkpoint_is_refused(tmp_path: Path) -> None:
    answer = call("evaluate", "checkpoint=none.ckpt", cwd=tmp_path)
    assert (answer.returncode, refusal(answer.stderr).about) == (2, "checkpoint")
    assert "no such file: none.ckpt" in answer.stderr


def test_what_a_resolver_refuses_is_one_line(tmp_path: Path) -> None:
    answer = call("prepare", "prepare.preset=papr", cwd=tmp_path)
    assert (answer.returncode, refusal(answer.stderr).about) == (2, "prepare.preset")
    assert "laptop, paper, smoke" in answer.stderr
    assert "'papr'" in answer.stderr


@pytest.mark.parametrize("program", sorted(RUNS))
def test_help_answers_without_heavy_imports(program: str, tmp_path: Path) -> None:
    answer = call(program, "--help", cwd=tmp_path)
    assert answer.returncode == 0
    assert f"col3d {program}" in answer.stdout or f"python {program}.py" in answer.stdout
    heavy = {"lightning", "timm", "torchvision"}
    if program in ("predict", "fuse", "export", "demo"):  # others have groups of parts, which are classes
        heavy |= {"torch", "cv2"}
    code = f"import sys; from col3d.cli import main\ntry: main([{program!r}, '--help'])\n"
    code += f"except SystemExit: pass\nassert not {heavy} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True, capture_output=True)


def test_folders_are_named_for_the_overrides() -> None:
    assert slug("") == "default"
    assert slug("model=bts,seed=0") == "model-bts_seed-0"
    one, other = slug("loss.lambdas=[0.5,0.3,0.2]"), slug("loss.lambdas=[0.5,0.3,0.2")
    assert one != other
    assert all(character not in one for character in "=[] /")
    assert len(slug("x=" + "y" * 500)) < 120


def test_threads_sleep_while_they_wait_unless_told_otherwise(tmp_path: Path) -> None:
    code = "import os; from col3d.cli import main; main(['--help']); print(os.environ['OMP_WAIT_POLICY'])"
    environment = {name: value for name, value in os.environ.items() if name != "OMP_WAIT_POLICY"}
    for given, expected in (({}, "PASSIVE"), ({"OMP_WAIT_POLICY": "ACTIVE"}, "ACTIVE")):
        call = [sys.executable, "-c", code]
        answer = subprocess.run(call, env=environment | given, capture_output=True, text=True, check=True)
        assert answer.stdout.splitlines()[-1] == expected
