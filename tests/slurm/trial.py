"""Sweeps on a real SLURM: preempted, out of time, with two processes a job; run by `make test-slurm`.

Each job ends in the numbers that it has without a cluster, to the bit.
"""

import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from cluster import cluster, output

PROJECT = Path(__file__).parents[2]
SMALL = [
    "preset=smoke", "model=bts", "data/split=custom", "data.size=[64,80]", "data.batch_size=2",
    "data.split.train=[cecum_t1_a,trans_t1_a:0-1]", "data.split.val=[trans_t1_a:1-2]",
    "data.split.test=[desc_t4_a]", "phantom.size=[64,80]", "phantom.frames_per_video=3", "callbacks.panels=0",
]  # fmt: skip
SLURM = ["hydra/launcher=slurm", "hydra.launcher.gpus_per_node=null", "hydra.launcher.cpus_per_task=1"]
LONGEST = 400


class Trial:
    """Sweeps below a folder, beside the same trainings without a cluster."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def alone(self, name: str, *options: str) -> dict[str, Any]:
        """The result of a training on this machine, as it is."""
        self._call(*SMALL, *self._data(), *options, f"hydra.run.dir={self.folder / name}").wait()
        return self.result(self.folder / name)

    def submitted(self, name: str, *options: str) -> "subprocess.Popen[bytes]":
        """A sweep on the cluster."""
        place = f"hydra.sweep.dir={self.folder / name}"
        return self._call("-m", *SMALL, *SLURM, *self._data(), *options, place)

    def jobs(self, name: str) -> list[Path]:
        """Folders of a sweep's jobs."""
        return sorted(path.parent for path in (self.folder / name).glob("*/status.json"))

    def result(self, folder: Path) -> dict[str, Any]:
        """What a training ended in."""
        content: dict[str, Any] = json.loads((folder / "result.json").read_text())
        return content

    def _data(self) -> list[str]:
        return [f"data.root={self.folder / 'phantom'}"]

    def _call(self, *arguments: str) -> "subprocess.Popen[bytes]":
        environment = {**os.environ, "OMP_NUM_THREADS": "1"}
        with (self.folder / "log.txt").open("a") as log:
            command = [sys.executable, str(PROJECT / "train.py"), *arguments]
            return subprocess.Popen(command, env=environment, cwd=self.folder, stdout=log, stderr=log)


def status(folder: Path) -> dict[str, Any]:
    """What a training said last."""
    content: dict[str, Any] = json.loads((folder / "status.json").read_text())
    return content


def until(there: Callable[[], object], what: str) -> None:
    """Wait for something."""
    start = time.monotonic()
    while not there():
        if time.monotonic() - start > LONGEST:
            raise SystemExit(f"{what}: not within {LONGEST} s\n{output('squeue')}")
        time.sleep(0.2)


def say(line: str) -> None:
    """A line of the transcript."""
    print(f"{time.strftime('%H:%M:%S')}  {line}", flush=True)


def preempted(trial: Trial) -> None:
    """A job that SLURM takes the machine from, by SIGTERM, is put back and goes on."""
    long = ["trainer.max_epochs=30", "callbacks.checkpoint_minutes=60"]
    expected = {seed: trial.alone(f"alone_{seed}", *long, f"seed={seed}") for seed in (0, 1)}
    sweep = trial.submitted("preempted", *long, "seed=0,1")
    until(lambda: any(status(job).get("epoch", 0) >= 3 for job in trial.jobs("preempted")), "a job at work")
    running = output("squeue", "-h", "-t", "R", "-o", "%i").split()
    say(f"running: {', '.join(running)}; scontrol requeue {running[0]}")
    output("scontrol", "requeue", running[0])
    until(lambda: any(status(job)["state"] == "preempted" for job in trial.jobs("preempted")), "a preemption")
    say("one has saved and left")
    assert sweep.wait(LONGEST) == 0
    report(trial, "preempted", expected)
    assert sorted(status(job)["sessions"] for job in trial.jobs("preempted")) == [1, 2]


def never_wait() -> None:
    """SLURM lets a job that was put back wait for two minutes; an administrator need not."""
    while True:
        for job in output("squeue", "-h", "-t", "PD", "-o", "%i").split():
            output("scontrol", "update", f"jobid={job}", "StartTime=now")
        time.sleep(1)


def out_of_time(trial: Trial) -> None:
    """A job that is told, by SIGUSR2, that its time is nearly up is put back by submitit and goes on."""
    long = ["trainer.max_epochs=50", "callbacks.checkpoint_minutes=60", "seed=0"]
    expected = {0: trial.alone("alone_long", *long)}
    limits = ["hydra.launcher.timeout_min=1", "hydra.launcher.signal_delay_s=35"]
    sweep = trial.submitted("out_of_time", *long, *limits)
    until(lambda: any(status(job)["state"] == "preempted" for job in trial.jobs("out_of_time")), "a signal")
    say(f"after {status(trial.jobs('out_of_time')[0])['epoch']} epochs a job has saved and left")
    assert sweep.wait(LONGEST) == 0
    report(trial, "out_of_time", expected)
    assert status(trial.jobs("out_of_time")[0])["sessions"] > 1


def two_processes(trial: Trial) -> None:
    """SLURM starts both processes of a job; they share its folder."""
    ddp = ["trainer=ddp", "trainer.devices=2", "trainer.accelerator=cpu", "trainer.max_epochs=2", "seed=0"]
    expected = {0: trial.alone("alone_ddp", *ddp)}
    assert trial.submitted("two_processes", *ddp).wait(LONGEST) == 0
    report(trial, "two_processes", expected)


def report(trial: Trial, name: str, expected: dict[int, dict[str, Any]]) -> None:
    """Hold every job against its training without a cluster."""
    jobs = trial.jobs(name)
    assert len(jobs) == len(expected)
    for job in jobs:
        seed = next(int(part[5:]) for part in status(job)["command"].split() if part.startswith("seed="))
        found = trial.result(job)
        assert status(job)["state"] == "done"
        assert found["best"] == expected[seed]["best"]
        assert found["metrics"] == expected[seed]["metrics"]
        say(
            f"{name}: seed {seed} done in {status(job)['sessions']} sessions, abs_rel "
            f"{found['metrics']['abs_rel']!r}, the same as without a cluster"
        )


def main() -> None:
    """Run all of it."""
    with tempfile.TemporaryDirectory() as made:
        trial = Trial(Path(made))
        trial.alone("rendered", "trainer.max_epochs=1")
        with cluster():
            threading.Thread(target=never_wait, daemon=True).start()
            say(output("sinfo", "-h", "-o", "SLURM with node %N, %c CPUs, %t").strip())
            for part in (two_processes, preempted, out_of_time):
                try:
                    part(trial)
                except BaseException:
                    print((trial.folder / "log.txt").read_text()[-6000:])
                    for log in trial.folder.glob("*/.submitit/*/*.err"):
                        print(log, log.read_text()[-3000:], sep="\n")
                    raise
    say("all as it should be")


if __name__ == "__main__":
    main()
