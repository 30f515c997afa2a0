"""The matrix of faults as a table in Markdown: `python -m tests.faults`."""

import argparse
import shutil
import signal
import sys
import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from col3d.io.run_files import RESULT, STATUS
from tests.faults.disks import (
    filled_disk,
    full_disk,
    little_shared_memory,
    read_only_from_the_start,
    read_only_later,
)
from tests.faults.files import (
    damaged,
    damaged_end,
    deleted_frame,
    emptied,
    flipped,
    noised,
    spoiled_frame,
    truncated,
)
from tests.faults.processes import (
    killed_while_writing,
    killed_worker,
    killed_worker_of_the_test,
    signalled,
    signalled_with_workers,
    two_on_one_folder,
)
from tests.faults.surroundings import jumping_clock, no_wandb
from tests.faults.training import LostError, NotMadeError
from tests.faults.trial import Trial, row

Make = Callable[[Trial], list[str]]
LAST, BEST, METRICS = "checkpoints/last.ckpt", "checkpoints/best.ckpt", "metrics.csv"
COLUMNS = ("fault", "made by", "exit code", "what it said", "status.json", "the same command then")
IN_TWO, AT_END, GROUP = "in epoch 2", "after the end", "to the process group, `data.workers=2`"
FAULTS: tuple[tuple[str, str, Make], ...] = (
    ("killed", f"SIGKILL {IN_TWO}", partial(signalled, signum=signal.SIGKILL)),
    (
        "killed while last.ckpt is written",
        "SIGKILL while its `.partial` is there",
        partial(killed_while_writing, name="last"),
    ),
    (
        "killed while best.ckpt is written",
        "SIGKILL while its `.partial` is there",
        partial(killed_while_writing, name="best"),
    ),
    ("asked to end", f"SIGTERM {IN_TWO}", partial(signalled, signum=signal.SIGTERM)),
    ("time is nearly up", f"SIGUSR1 {IN_TWO}", partial(signalled, signum=signal.SIGUSR1)),
    ("Ctrl-C", f"SIGINT {IN_TWO}", partial(signalled, signum=signal.SIGINT)),
    ("asked to end, workers too", f"SIGTERM {GROUP}", partial(signalled_with_workers, signum=signal.SIGTERM)),
    (
        "time is nearly up, workers too",
        f"SIGUSR1 {GROUP}",
        partial(signalled_with_workers, signum=signal.SIGUSR1),
    ),
    ("Ctrl-C, workers too", f"SIGINT {GROUP}", partial(signalled_with_workers, signum=signal.SIGINT)),
    ("disk too small", "tmpfs of 2.5 checkpoints; then enlarged", full_disk),
    (
        "disk filled by another program",
        "every free byte of a tmpfs, from epoch 2 on; then freed",
        filled_disk,
    ),
    ("read-only from the start", "read-only bind mount; then unmounted", read_only_from_the_start),
    ("turns read-only", f"read-only bind mount {IN_TWO}; then unmounted", read_only_later),
    ("frame deleted", f"a colour file removed {IN_TWO}; then put back", deleted_frame),
    ("frame spoiled", f"a colour file overwritten with noise {IN_TWO}; then put back", spoiled_frame),
    ("data worker killed", f"SIGKILL to one of `data.workers=2` {IN_TWO}", killed_worker),
    ("data worker of the test killed", "SIGKILL to one of `data.workers=2`", killed_worker_of_the_test),
    ("shared memory full", "/dev/shm of 64 kB, `data.workers=2`; then as it was", little_shared_memory),
    ("last.ckpt cut short", f"killed {IN_TWO}, halved", lambda trial: damaged(trial, truncated, LAST)),
    ("last.ckpt changed", f"killed {IN_TWO}, a bit flipped", lambda trial: damaged(trial, flipped, LAST)),
    ("best.ckpt changed", f"killed {IN_TWO}, a bit flipped", lambda trial: damaged(trial, flipped, BEST)),
    (
        "both checkpoints changed",
        f"killed {IN_TWO}, a bit flipped in each",
        lambda trial: damaged(trial, flipped, LAST, BEST),
    ),
    ("status.json cut short", f"killed {IN_TWO}, halved", lambda trial: damaged(trial, truncated, STATUS)),
    ("metrics.csv cut short", f"killed {IN_TWO}, halved", lambda trial: damaged(trial, truncated, METRICS)),
    (
        "metrics.csv changed",
        f"killed {IN_TWO}, its first byte no text",
        lambda trial: damaged(trial, noised, METRICS),
    ),
    (
        "config.yaml emptied",
        f"killed {IN_TWO}, cut to nothing",
        lambda trial: damaged(trial, emptied, "config.yaml"),
    ),
    ("result.json cut short", f"halved {AT_END}", lambda trial: damaged_end(trial, truncated, RESULT)),
    (
        "summary.json cut short",
        f"halved {AT_END}",
        lambda trial: damaged_end(trial, truncated, "summary.json"),
    ),
    ("W&B without a key", "`logger.wandb.offline=false`, no key", partial(no_wandb, kind="no key")),
    ("W&B refuses", "`logger.wandb.offline=false`, a closed port", partial(no_wandb, kind="refuses")),
    (
        "W&B is silent",
        "`logger.wandb.offline=false`, a server that never answers",
        partial(no_wandb, kind="silent"),
    ),
    ("clock jumps", "the time of day jumps by hours every third time it is read", jumping_clock),
    ("two on one folder", f"a second process {IN_TWO} of the first", two_on_one_folder),
)
"""Name, how it is made, and what makes it and gives the other columns."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the matrix; exit code 1 where anything is not as promised."""
    parser = argparse.ArgumentParser("faults", description=__doc__)
    parser.add_argument("--only", default="", metavar="TEXT", help="faults with this in their name")
    parser.add_argument("--cache", type=Path, help="folder for runs, kept; a temporary one when absent")
    options = parser.parse_args(arguments)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # leaves no process and no mount behind
    with tempfile.TemporaryDirectory(prefix="faults-") as temporary:
        place = (options.cache or Path(temporary)).absolute()
        trial = Trial(place / "undisturbed", place / "frames", place / "undisturbed" / "run")
        trial.place.mkdir(parents=True, exist_ok=True)
        with trial.keep:
            training = trial.start()
            if training.end():
                raise SystemExit(training.said)
        print(row(COLUMNS), row(["---"] * len(COLUMNS)), sep="\n", flush=True)
        chosen = [fault for fault in FAULTS if options.only in fault[0]]
        rows = [tried(place, trial, *fault) for fault in chosen]
    return int(any(wrong(cells) for cells in rows))


def tried(place: Path, undisturbed: Trial, fault: str, made: str, make: Make) -> list[str]:
    """The row of a fault, printed as soon as it is known."""
    own = place / "trial"
    shutil.rmtree(own, ignore_errors=True)
    own.mkdir()
    trial = Trial(own, undisturbed.root, undisturbed.whole)
    try:
        with trial.keep:
            cells = make(trial)
    except NotMadeError as error:
        cells = [f"skipped: {error}", "", "", ""]
    except LostError as error:
        cells = [f"FAILED: {error}", "", "", ""]
    print(row([fault, made, *cells]), flush=True)
    shutil.rmtree(own, ignore_errors=True)
    return cells


def wrong(cells: Sequence[str]) -> bool:
    """Whether a row shouts."""
    shouts = ("STACK", "EXIT", "DIFFERENT", "LEFT", "FAILED", "WRONG", "UNFINISHED")
    return any(shout in cell for cell in cells for shout in shouts)


if __name__ == "__main__":
    sys.exit(main())
