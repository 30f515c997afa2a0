"""Sweeps as a user runs them: two at a time, again, with jobs that fail, with two processes a job."""

import json
import os
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from programs import call, command
from refusals import refusal
from tiny_run import SMALL, TINY

from col3d.io.run_files import Job, read_sweep
from col3d.reports.ledger import main as ledger
from col3d.training.train import train

pytestmark = pytest.mark.end_to_end

Compose = Callable[..., dict[str, Any]]


@pytest.fixture
def root(tiny: Compose, phantom_root: Path) -> Path:
    """Rendered, so that no job has to."""
    train(tiny("model=bts", SMALL))
    return phantom_root


def arguments(root: Path, sweep: Path, *more: str) -> list[str]:
    return ["-m", *TINY, "model=bts", SMALL, f"data.root={root}", f"hydra.sweep.dir={sweep}", *more]


def jobs_of(sweep: Path, option: str) -> dict[str, Job]:
    """By what each has of an option."""
    plan = json.loads((sweep / "sweep.json").read_text())["jobs"]
    value = {name: dict(text.split("=", 1) for text in overrides)[option] for name, overrides in plan.items()}
    return {value[job.name]: job for job in read_sweep(sweep)}


def test_a_sweep_overwrites_each_run_once(root: Path, tmp_path: Path) -> None:
    sweep = tmp_path / "sweep"

    def run(rates: str, code: int) -> str:
        given = arguments(root, sweep, "overwrite=true", f"optimizer.lr={rates}")
        answer = call("train.py", *given, cwd=tmp_path)
        assert answer.returncode == code, answer.stderr
        return answer.stdout

    for finished in (0, 1):  # one job fails: the sweep is still to be gone on with
        said = run("1e-3,1e30", 2)
        assert said.count("finished before") == finished
    said = run("1e-3", 0)
    assert said.count("finished before") == 1
    assert "epoch 1/1" in run("1e-3", 0)
    assert not (sweep / ".overwrite.json").exists()


def test_two_processes_share_a_sweep_and_a_third_has_nothing_to_do(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sweep = tmp_path / "sweep"
    words = [*command("train.py"), *arguments(root, sweep, "seed=0,1,2")]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    both = [
        subprocess.Popen(words, cwd=tmp_path, env=environment, stdout=subprocess.PIPE, text=True)
        for _ in range(2)
    ]
    said = [process.communicate()[0] for process in both]
    assert [process.returncode for process in both] == [0, 0], said
    jobs = jobs_of(sweep, "seed")
    assert set(jobs) == {"0", "1", "2"}
    assert {(job.state, job.status["sessions"]) for job in jobs.values()} == {("done", 1)}
    assert len({job.result["hash"] for job in jobs.values()}) == 3
    assert "".join(said).count("epoch 1/1") == 3
    again = call("train.py", *arguments(root, sweep, "seed=0,1,2"), cwd=tmp_path)
    assert again.returncode == 0
    assert again.stdout.count("finished before") == 3
    assert "epoch 1/1" not in again.stdout
    assert ledger([str(sweep)]) == 0
    assert "3 done" in capsys.readouterr().out


def test_a_job_that_fails_is_named_and_the_others_run(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sweep = tmp_path / "sweep"
    swept = "data.split.test=[nowhere],[desc_t4_a]"
    answer = call("train.py", *arguments(root, sweep, swept), cwd=tmp_path)
    assert answer.returncode == 2
    assert answer.stderr.count("error:") == 1
    assert "nowhere" in answer.stderr
    assert "Traceback" not in answer.stderr
    jobs = jobs_of(sweep, "data.split.test")
    assert {test: job.state for test, job in jobs.items()} == {"[nowhere]": "failed", "[desc_t4_a]": "done"}
    assert "'nowhere'" in jobs["[nowhere]"].status["error"]
    assert ledger([str(sweep)]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "1 done, 1 failed" in shown
    assert "'nowhere' is neither" in shown


def test_each_job_of_two_processes_has_one_folder(root: Path, tmp_path: Path) -> None:
    """Lightning's second process is started for one job, not for the sweep."""
    sweep = tmp_path / "sweep"
    ddp = ["trainer=ddp", "trainer.devices=2", "trainer.accelerator=cpu", "seed=0,1"]
    answer = call("train.py", *arguments(root, sweep, *ddp), cwd=tmp_path)
    assert answer.returncode == 0, answer.stderr
    jobs = jobs_of(sweep, "seed")
    assert {seed: (job.state, job.status["sessions"]) for seed, job in jobs.items()} == {
        "0": ("done", 1),
        "1": ("done", 1),
    }
    assert {path.name for path in sweep.iterdir() if path.is_dir()} == {job.name for job in jobs.values()}
    assert not [path for path in tmp_path.iterdir() if path.name not in ("sweep", "run", "phantom")]


def test_jobs_at_a_time_have_the_numbers_of_one_after_the_other(root: Path, tmp_path: Path) -> None:
    """With workers that load data, which joblib's own way of starting processes would not allow."""
    one, many = tmp_path / "one", tmp_path / "many"
    joblib = ["hydra/launcher=joblib", "hydra.launcher.n_jobs=2", "data.workers=1"]
    for sweep, more in ((one, []), (many, joblib)):
        answer = call("train.py", *arguments(root, sweep, *more, "seed=0,1"), cwd=tmp_path)
        assert answer.returncode == 0, answer.stderr
    found, expected = jobs_of(many, "seed"), jobs_of(one, "seed")
    for seed in ("0", "1"):
        assert found[seed].result["best"] == expected[seed].result["best"]
        assert found[seed].result["metrics"] == expected[seed].result["metrics"]


@pytest.mark.parametrize(
    ("arguments", "option"),
    [
        (["+hydra.callbacks.mine._target_=os.system"], "hydra.callbacks.mine._target_"),
        (["-m", "seed=0,1", "hydra.launcher._target_=subprocess.run"], "hydra.launcher._target_"),
        (["+model._target_=torch.load"], "model._target_"),
        (["--config-dir=mine", "+bad=evil"], "hydra.job_logging.handlers.evil.()"),
    ],
)
def test_what_a_file_may_build_is_limited(arguments: list[str], option: str, tmp_path: Path) -> None:
    group = tmp_path / "mine" / "bad"
    group.mkdir(parents=True)
    content = "# @package hydra.job_logging.handlers\nevil: {'()': os.mkdir, path: executed}\n"
    (group / "evil.yaml").write_text(content)
    answer = call("train.py", *arguments, cwd=tmp_path)
    assert answer.returncode == 2
    assert refusal(answer.stderr).about == option
    assert "built" in answer.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]
