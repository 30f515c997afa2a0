"""Disks without room, disks that may not be written to, and too little shared memory: mounts, as root."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress

from tests.faults.training import LONGEST, NotMadeError
from tests.faults.trial import Trial


def full_disk(trial: Trial) -> list[str]:
    """Room for two checkpoints and a half."""
    size = int(2.5 * (trial.whole / "checkpoints" / "last.ckpt").stat().st_size)
    mount(trial, "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(trial.run))
    answer = trial.ended(trial.start())
    _called("mount", "-o", f"remount,size={4 * size}", str(trial.run))
    return [*answer, trial.then()]


def filled_disk(trial: Trial) -> list[str]:
    """Another program writes whatever room there is."""
    mount(trial, "-t", "tmpfs", "-o", "size=64m", "tmpfs", str(trial.run))
    training, filler = trial.start_to_second_epoch(), trial.run / "filler"
    with filler.open("wb", buffering=0) as file:
        while training.process.poll() is None:
            with suppress(OSError):
                while file.write(bytes(1 << 16)):
                    pass
    answer = trial.ended(training)
    filler.unlink()
    return [*answer, trial.then()]


def read_only_from_the_start(trial: Trial) -> list[str]:
    """A folder that may not be written to."""
    with mounted_read_only(trial):
        answer = trial.ended(trial.start())
    return [*answer, trial.then()]


def read_only_later(trial: Trial) -> list[str]:
    """A disk that the system turns read-only."""
    training = trial.start_to_second_epoch()
    with mounted_read_only(trial):
        answer = trial.ended(training)
    return [*answer, trial.then()]


def little_shared_memory(trial: Trial) -> list[str]:
    """A /dev/shm of 64 kB, seen by this process alone."""
    trial.more.append("data.workers=2")
    _needs_root()
    own = ["unshare", "--mount", "sh", "-c", 'mount -t tmpfs -o size=64k tmpfs /dev/shm && exec "$@"', "sh"]
    return [*trial.ended(trial.start(before=own)), trial.then()]


def _needs_root() -> None:
    if sys.platform != "linux" or os.geteuid() != 0:
        raise NotMadeError("needs root")


def _called(*command: str) -> None:
    answer = subprocess.run(command, capture_output=True, text=True, check=False, timeout=LONGEST)
    if answer.returncode:
        raise NotMadeError(f"needs root: {answer.stderr.strip()}")


def mount(trial: Trial, *arguments: str) -> None:
    """Mount over the run folder for the time of a trial."""
    _needs_root()
    trial.run.mkdir(exist_ok=True)
    _called("mount", *arguments)
    trial.keep.callback(_called, "umount", "--lazy", str(trial.run))


@contextmanager
def mounted_read_only(trial: Trial) -> Iterator[None]:
    """Mount the run folder over itself; root may write in spite of permissions, but not there."""
    _needs_root()
    trial.run.mkdir(exist_ok=True)
    with ExitStack() as stack:
        _called("mount", "--bind", str(trial.run), str(trial.run))
        stack.callback(_called, "umount", "--lazy", str(trial.run))
        _called("mount", "-o", "remount,bind,ro", str(trial.run))
        yield


Make = Callable[[Trial], list[str]]
LAST, BEST, METRICS = "checkpoints/last.ckpt", "checkpoints/best.ckpt", "metrics.csv"
