"""The paper's experiments as jobs, each run once, and their report."""

import json
import secrets
import signal
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from programs import PROJECT, call
from refusals import refusal, refused
from tiny_run import SMALL, TINY, composed

from col3d.cli.sweeps import sweep_of
from col3d.errors import UserError
from col3d.runs.identity import hash_of
from col3d.signals import Stopped
from col3d.training import benchmark as running
from col3d.training.benchmark import Job, distinct, make_job, run_benchmark

pytestmark = pytest.mark.end_to_end

Compose = Callable[..., dict[str, Any]]


def jobs_of(*experiments: str, seeds: tuple[int, ...] = (0,)) -> list[Job]:
    rows = [row for name in experiments for row in sweep_of(name, seeds)]
    return [make_job(row, composed("train", *row, f"output_dir=runs/{i}")) for i, row in enumerate(rows)]


def test_the_ablation_has_the_rows_of_the_paper() -> None:
    rows = [
        (j.options.model.name, *(term.term for term in j.options.loss.terms.values()))
        for j in jobs_of("ablation")
    ]
    assert rows == [
        ("bts", "silog"),
        ("bts_cbam", "silog"),
        ("bts_cbam_mtl", "silog", "normal_l1"),
        ("bts_cbam_mtl", "silog", "normal_rmse"),
        ("col3d_mtl", "silog", "normal_l1", "cross_task_rmse"),
        ("col3d_mtl", "silog", "normal_rmse", "cross_task_rmse"),
    ]


def test_the_lambda_study_has_the_rows_of_the_paper() -> None:
    found = [tuple(job.options.loss.lambdas) for job in jobs_of("lambda_study")]
    table = PROJECT / "src" / "col3d" / "reports" / "paper" / "lambda_val.csv"
    printed = [tuple(map(float, line.split(",")[:3])) for line in table.read_text().splitlines()[1:]]
    assert found == printed


def test_what_experiments_share_is_run_once() -> None:
    jobs = jobs_of("ablation", "lambda_study", "benchmark")
    assert (len(jobs), len(distinct(jobs))) == (19, 16)
    twice = jobs_of("benchmark", seeds=(3, 4))
    assert len(distinct(twice)) == 10
    assert {job.options.seed for job in twice} == {3, 4}


def test_an_experiment_that_sweeps_over_nothing_is_refused() -> None:
    with refused(UserError, "benchmark.experiments", "ablation, benchmark, lambda_study", "overfit"):
        sweep_of("overfit", [0])


@pytest.mark.filterwarnings("ignore:.*pin_memory.*")
def test_jobs_are_run_once_and_reported_and_one_that_fails_is_named(
    phantom_root: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "benchmark"

    def job(name: str, *overrides: str) -> Job:
        asked = [*TINY, f"data.root={phantom_root}", "callbacks.predictions=true", *overrides]
        return make_job(asked, composed("train", *asked, f"output_dir={output / 'runs' / name}"))

    jobs = [
        job("bts", "model=bts", SMALL),
        job("bts_again", "model=bts", SMALL),
        job("bad", "model=bts", SMALL, "optimizer.lr=1e30"),
    ]
    with refused(UserError, None, "/runs/bad: ", "optimizer.lr"):
        run_benchmark(jobs, output, parallel=2)
    said = capfd.readouterr().out
    assert "2 runs, 0 of them finished before" in said
    assert "run 2 of 2" in said
    assert json.loads((output / "runs" / "bts" / "summary.json").read_text())["commit"] != ""
    page = (output / "report" / "report.html").read_text()
    assert "BTS" in page
    assert "A phantom is not C3VD" in page
    assert (output / "report" / "figures" / "data_sheet.png").is_file()
    before = (output / "runs" / "bts" / "log.txt").stat().st_mtime_ns
    run_benchmark(jobs[:1], output, parallel=2)
    assert "1 runs, 1 of them finished before" in capfd.readouterr().out
    assert (output / "runs" / "bts" / "log.txt").stat().st_mtime_ns == before


@pytest.mark.filterwarnings("ignore:.*pin_memory.*")
def test_finished_runs_are_overwritten_once(
    phantom_root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(running, "keep_truth", lambda *_: None)
    output, trained = tmp_path / "benchmark", list[str]()

    def job(name: str, *overrides: str) -> Job:
        asked = [*TINY, f"data.root={phantom_root}", "overwrite=true", *overrides]
        return make_job(asked, composed("train", *asked, f"output_dir={output / 'runs' / name}"))

    def run(job: Job, *_: object) -> str:
        if len(trained) == stop_at:
            raise Stopped(signal.SIGTERM)
        trained.append(job.folder.name)
        job.folder.mkdir(parents=True, exist_ok=True)
        facts = {"hash": hash_of(job.options), "run": secrets.token_hex(4), "best": {"loss": 1.0}}
        (job.folder / "result.json").write_text(json.dumps(facts))
        return "done"

    monkeypatch.setattr(running, "run_job", run)
    monkeypatch.setattr(running.subprocess, "run", lambda *_, **__: SimpleNamespace(returncode=0))
    jobs = [job("a", SMALL), job("b", SMALL, "seed=1"), job("c", SMALL, "seed=2")]
    for stop_at, expected in (
        (-1, ["a", "b", "c"]),
        (1, ["a"]),  # stopped within a benchmark that is asked to overwrite all
        (1, ["b"]),
        (-1, ["c"]),
        (-1, ["a", "b", "c"]),
    ):
        trained.clear()
        if stop_at < 0:
            run_benchmark(jobs, output, parallel=1)
        else:
            with pytest.raises(SystemExit):
                run_benchmark(jobs, output, parallel=1)
        assert trained == expected
    assert not (output / "runs" / ".overwrite.json").exists()


def test_bad_input_is_one_line(tmp_path: Path) -> None:
    for argument in (
        "benchmark.experiments=[overfit]",
        "benchmark.seeds=[]",
        "model.widht=3",
        "optimizer.lr=-1",
    ):
        answer = call("benchmark", argument, cwd=tmp_path)
        assert answer.returncode == 2
        assert refusal(answer.stderr).about == argument.partition("=")[0]
