"""Execution of a benchmark: run its trainings, several at a time, and write their report."""

import os
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from col3d.data.build import data_module, resolve_source_paths
from col3d.errors import UserError
from col3d.evaluation.stored_truth import keep_truth
from col3d.io.ownership import Owned
from col3d.io.run_files import add_to_plan, is_locked, read_job
from col3d.registry.refusals import check_options
from col3d.runs.folder import RunFolder
from col3d.runs.overwriting import begin, end
from col3d.runs.provenance import command
from col3d.signals import stoppable
from col3d.training.options import TrainOptions
from col3d.training.run_request import run_request

COL3D = (sys.executable, "-m", "col3d")


@dataclass(frozen=True)
class Job:
    """One training of a benchmark: its overrides on the command line, and its checked options."""

    overrides: tuple[str, ...]
    options: TrainOptions

    @property
    def folder(self) -> Path:
        """Folder of the run."""
        return Path(self.options.output_dir)


def make_job(overrides: Sequence[str], given: Mapping[str, Any]) -> Job:
    """Make a job, after checking its options.

    Raises:
        UserError: an option breaks a rule.
    """
    options = check_options(TrainOptions, given)
    data = resolve_source_paths(options.data, options.phantom)
    return Job(tuple(overrides), options.model_copy(update={"data": data}))


def distinct(jobs: Sequence[Job]) -> list[Job]:
    """Drop jobs with the same options as an earlier one, apart from the folder."""
    kept: dict[str, Job] = {}
    for job in jobs:
        kept.setdefault(job.options.model_dump_json(exclude={"output_dir"}), job)
    return list(kept.values())


def run_benchmark(jobs: Sequence[Job], output: Path, parallel: int | None = None) -> None:
    """Run unfinished jobs, store the ground truth for figures, and write the report.

    Args:
        jobs: the trainings.
        output: folder for the runs and the report.
        parallel: number of jobs at a time, which share the cores; by default two, or one with a GPU.

    Raises:
        UserError: a folder holds a run of other options, or every job failed.
    """
    jobs = distinct(jobs)
    add_to_plan(output / "runs", {job.folder.name: job.overrides for job in jobs}, command())
    if jobs[0].options.overwrite:
        begin(output / "runs", [job.folder.name for job in jobs], "benchmark.output")
    waiting = [job for job in jobs if not RunFolder(run_request(job.options)).finished]
    print(f"{len(jobs)} runs, {len(jobs) - len(waiting)} of them finished before", flush=True)
    if waiting:  # render data once, before several jobs need it
        first = jobs[0].options
        data_module(first.data, first.phantom, first.seed)
    with stoppable("finished runs stay, and the same command goes on"):
        _run_all(waiting, parallel or (1 if torch.cuda.is_available() else 2))
    states = [(job, read_job(job.folder).state) for job in jobs]
    failed = [job for job, state in states if state not in ("done", "running")]
    if len(failed) == len(jobs):
        raise UserError(f"all {len(jobs)} runs failed; the first says: {_last_line(failed[0])}")
    if elsewhere := [job.folder.name for job, state in states if state == "running"]:
        raise UserError(
            f"another process still trains {', '.join(elsewhere)}; the same command reports when it is done"
        )
    kept = jobs[0].options
    keep_truth(output / "truth", kept.data, kept.phantom, kept.model.max_depth)
    write = [*COL3D, "report", str(output), str(output / "report")]
    if subprocess.run(write, check=False).returncode:
        raise UserError(f"the runs are there; their report in {output / 'report'} is not, as said above")
    if failed:
        raise UserError("\n".join(f"failed: {job.folder}: {_last_line(job)}" for job in failed))
    end(output / "runs")


def _run_all(jobs: Sequence[Job], parallel: int) -> None:
    """Run all jobs; if this process is stopped, they are terminated as well, and save first."""
    start, done = time.monotonic(), 0
    threads = str(max(1, (os.cpu_count() or 1) // parallel))
    processes: list[subprocess.Popen[bytes]] = []
    with ThreadPoolExecutor(parallel) as pool:
        running = {pool.submit(run_job, job, threads, processes): job for job in jobs}
        try:
            while running:
                finished, _ = wait(running, return_when=FIRST_COMPLETED)
                for future in finished:
                    job, done = running.pop(future), done + 1
                    left = _clock((time.monotonic() - start) / done * (len(jobs) - done))
                    line = f"run {done} of {len(jobs)} {future.result()}, {left} left: {job.folder.name}"
                    print(line, flush=True)
        except BaseException:
            for future in running:
                future.cancel()
            for process in processes:
                process.terminate()
            raise


def run_job(job: Job, threads: str, processes: "list[subprocess.Popen[bytes]]") -> str:
    """Run a job with its output in `log.txt`, in its own session, so that Ctrl-C does not reach it."""
    if is_locked(job.folder):
        return "left to another process"
    owned = Owned(job.folder, "log", "benchmark.output")
    if read_job(job.folder).status:  # the folder holds a run
        owned.adopt("log.txt")
    owned.claim("log.txt")
    with (job.folder / "log.txt").open("w", encoding="utf-8") as log:
        process = subprocess.Popen(
            [*COL3D, "train", *job.overrides, f"hydra.run.dir={job.folder}"],
            env={**os.environ, "OMP_NUM_THREADS": threads},
            stdout=log,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        processes.append(process)
        return "done" if process.wait() == 0 else "FAILED"


def _last_line(job: Job) -> str:
    text = (job.folder / "log.txt").read_text(encoding="utf-8")
    lines = [line for line in text.split("\n") if line.strip()]
    return next((line for line in lines if line.startswith("error:")), lines[-1] if lines else "nothing")


def _clock(seconds: float) -> str:
    return f"{seconds / 60:.0f} min" if seconds > 90 else f"{seconds:.0f} s"
