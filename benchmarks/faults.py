"""What becomes of a training that something goes wrong with: `python -m benchmarks.faults`.

Each fault is made for `train.py` in a process of its own, when an event is seen: a line that it prints, or a
file that appears. Then the same command runs again, and what it ends in is held against an undisturbed run.
"""

import argparse
import csv
import os
import random
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

import torch

from col3d.reports.jobs import RESULT, STATUS, read_job, read_plain

PROJECT = Path(__file__).parents[1]
EPOCHS = 3
OPTIONS = (
    "preset=smoke",
    "model=bts",
    "model.encoder=lcnet_035",
    "data/split=custom",
    "data.split.train=[cecum_t1_a,trans_t1_a:0-1]",
    "data.split.val=[trans_t1_a:1-2]",
    "data.split.test=[desc_t4_a,trans_t1_a:2-2]",
    "data.size=[64,80]",
    "data.batch_size=2",
    "phantom.size=[64,80]",
    "phantom.frames_per_video=3",
    "callbacks.panels=1",
    "callbacks.checkpoint_minutes=0",
    "trainer.accelerator=cpu",
    f"trainer.max_epochs={EPOCHS}",
)
"""The smallest training that has every part; it saves after every step."""
LONGEST = 300.0
"""Seconds that a training may take, with whatever it waits for."""
POLL = 0.001
TRAINED_FRAME = Path("cecum_t1_a") / "0001_color.png"
SAID = ("error:", "note:", "stopped;")
SAME = "the same weights and tables to the bit"
COLUMNS = ("fault", "made by", "exit code", "what it said", "status.json", "the same command then")
JUMPING_CLOCK = """
import datetime, itertools, time

hours, calls, real, now = (0, 7, -5, 30, -48), itertools.count(), time.time, datetime.datetime.now
offset = lambda: 3600 * hours[next(calls) // 3 % len(hours)]

class Jumping(datetime.datetime):
    @classmethod
    def now(cls, tz=None):
        return now(tz) + datetime.timedelta(seconds=offset())

datetime.datetime = Jumping
time.time = lambda: real() + offset()
time.time_ns = lambda: int(1e9 * time.time())
"""
"""A sitecustomize.py that puts the clock forward and back by hours; time.monotonic stays what it is."""


class NotMadeError(Exception):
    """A fault cannot be made on this machine."""


class LostError(Exception):
    """What was waited for did not come."""


class Training:
    """`train.py` in a process group of its own.

    Args:
        arguments: of the command line.
        log: where it prints.
        environment: what differs from this program's.
        before: a command that starts it.
    """

    def __init__(
        self,
        arguments: Sequence[str],
        log: Path,
        environment: Mapping[str, str] | None = None,
        before: Sequence[str] = (),
    ) -> None:
        self.log, self.start = log, time.monotonic()
        with log.open("w") as out:
            self.process = subprocess.Popen(
                [*before, sys.executable, str(PROJECT / "train.py"), *arguments],
                cwd=log.parent,
                env={**os.environ, "OMP_NUM_THREADS": "1", **(environment or {})},
                stdout=out,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    @property
    def said(self) -> str:
        """All that it has printed."""
        return self.log.read_text(errors="replace")

    def until(self, happened: Callable[[], bool]) -> None:
        """Wait for an event.

        Raises:
            LostError: the training ended before it.
        """
        while not happened():
            if self.process.poll() is not None or time.monotonic() - self.start > LONGEST:
                self.close()
                raise LostError(f"the event never came: {self.said[-2000:]}")
            time.sleep(POLL)

    def workers(self) -> list[int]:
        """Processes that load its data."""
        path = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children")
        return [int(number) for number in path.read_text().split()]

    def send(self, signum: int, group: bool = False) -> None:
        """A signal to the process, or to its workers, too, as a terminal and a scheduler do."""
        (os.killpg if group else os.kill)(self.process.pid, signum)

    def end(self) -> int:
        """Its exit code, negative where a signal killed it."""
        try:
            return self.process.wait(max(1.0, LONGEST - time.monotonic() + self.start))
        except subprocess.TimeoutExpired:
            raise LostError(f"it hangs: {self.said[-2000:]}") from None
        finally:
            self.close()

    def close(self) -> None:
        """Leave no process behind."""
        with suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()


@dataclass
class Trial:
    """A folder for the trainings of one fault.

    Attributes:
        place: of everything.
        root: of the data set.
        whole: folder of the undisturbed run.
        more: options beside `OPTIONS`.
        keep: context managers that end with the trial.
    """

    place: Path
    root: Path
    whole: Path
    more: list[str] = field(default_factory=list)
    keep: ExitStack = field(default_factory=ExitStack)
    runs: int = 0

    @property
    def run(self) -> Path:
        """The folder of the training."""
        return self.place / "run"

    @property
    def last(self) -> Path:
        """What it goes on from."""
        return self.run / "checkpoints" / "last.ckpt"

    @property
    def best(self) -> Path:
        """What is evaluated."""
        return self.run / "checkpoints" / "best.ckpt"

    def start(self, environment: Mapping[str, str] | None = None, before: Sequence[str] = ()) -> Training:
        """The command."""
        self.runs += 1
        arguments = [*OPTIONS, *self.more, f"data.root={self.root}", f"hydra.run.dir={self.run}"]
        training = Training(arguments, self.place / f"log_{self.runs}.txt", environment, before)
        self.keep.callback(training.close)
        return training

    def start_to_second_epoch(self, environment: Mapping[str, str] | None = None) -> Training:
        """The command, until the first step of the second epoch is saved."""
        training = self.start(environment)
        training.until(lambda: f"epoch 1/{EPOCHS}" in training.said)
        for _ in range(2):  # the end of the first epoch, and that step
            before = _identity(self.last)
            training.until(lambda seen=before: _identity(self.last) not in (seen, None))  # type: ignore[misc]
        return training

    def own_data(self) -> None:
        """A data set to spoil."""
        self.root = Path(shutil.copytree(self.root, self.place / "frames"))

    def state(self) -> str:
        """What status.json says; what the ledger makes of it, where that is something else."""
        said, shown = read_plain(self.run / STATUS).get("state", "none"), read_job(self.run).state
        return str(said) if said == shown else f"{said} (ledger: {shown})"

    def ended(self, training: Training) -> list[str]:
        """Exit code, what was said and the state."""
        code = training.end()
        return [str(code), self.line_of(training), self.state()]

    def line_of(self, training: Training) -> str:
        """What a training said of the fault, its paths shortened."""
        lines = training.said.splitlines()
        found = [line for line in lines if line.startswith(SAID)]
        text = " / ".join(dict.fromkeys(found)) or "nothing"
        if any(line.startswith("Traceback") for line in lines):
            text = f"STACK TRACE, {lines[-1].strip()}"
        for path, name in ((self.run, "RUN"), (self.root, "DATA"), (self.place, "TMP")):
            text = text.replace(str(path), name)
        return re.sub(r"\d{5,}", "N", text).replace(f" on {socket.gethostname()}", " on HOST")

    def then(self, expected_code: int = 0, **options: Any) -> str:
        """Run the command again, and say what came of it."""
        training = self.start(**options)
        code = training.end()
        if code != expected_code or "Traceback" in training.said:
            return f"EXIT CODE {code}: {self.line_of(training)}"
        return f"{self.way_of(training)}{self.compared()}"

    def way_of(self, training: Training) -> str:
        """Where a training began."""
        lines = training.said.splitlines()
        origin = [Path(line.split()[-1]).name for line in lines if line.startswith("goes on from")]
        first = next((line.split()[1].split("/")[0] for line in lines if line.startswith("epoch ")), None)
        where = "after the last epoch" if first is None else f"in epoch {first}"
        begin = f"went on from {origin[0]} {where}" if origin else f"began anew {where}"
        noted = [line for line in lines if line.startswith("note:")]
        return f"{begin}{' and said so' if noted else ''}; "

    def compared(self) -> str:
        """Which files differ from those of the undisturbed run."""
        if not read_plain(self.run / RESULT):
            return f"UNFINISHED: no {RESULT}"
        differing = [f"{n}.ckpt" for n in ("best", "last") if _weights_differ(self.run, self.whole, n)]
        for name in ("metrics.csv", "per_frame.csv"):
            if (self.run / name).read_text() != (self.whole / name).read_text():
                differing.append(name)
        if read_plain(self.run / RESULT)["best"] != read_plain(self.whole / RESULT)["best"]:
            differing.append(RESULT)
        left = [str(path.relative_to(self.run)) for path in self.run.rglob("*.partial*")]
        text = f"DIFFERENT: {', '.join(differing)}" if differing else SAME
        return f"{text}; LEFT BEHIND: {', '.join(left)}" if left else text


def _identity(path: Path) -> int | None:
    with suppress(FileNotFoundError):
        return path.stat().st_mtime_ns
    return None


def _weights_differ(run: Path, whole: Path, name: str) -> bool:
    found, expected = (
        torch.load(folder / "checkpoints" / f"{name}.ckpt", weights_only=True, mmap=True)["state_dict"]
        for folder in (run, whole)
    )
    return found.keys() != expected.keys() or any(
        values.numpy().tobytes() != expected[key].numpy().tobytes() for key, values in found.items()
    )


def signalled(trial: Trial, signum: int, group: bool = False) -> list[str]:
    """A signal in the second epoch."""
    training = trial.start_to_second_epoch()
    training.send(signum, group)
    return [*trial.ended(training), trial.then()]


def signalled_with_workers(trial: Trial, signum: int) -> list[str]:
    """The same, to all processes of a training that has more."""
    trial.more.append("data.workers=2")
    return signalled(trial, signum, group=True)


def killed_while_writing(trial: Trial, name: str) -> list[str]:
    """Half a checkpoint is there when the process dies."""
    partial_file = trial.run / "checkpoints" / f"{name}.ckpt.partial"
    training = trial.start_to_second_epoch() if name == "last" else trial.start()
    while not partial_file.is_file():
        training.until(partial_file.is_file)
        training.send(signal.SIGSTOP)  # a look without hurry
        if not partial_file.is_file():
            training.send(signal.SIGCONT)
    training.send(signal.SIGKILL)
    return [*trial.ended(training), trial.then()]


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


def deleted_frame(trial: Trial) -> list[str]:
    """A colour file vanishes."""
    trial.own_data()
    path, aside = trial.root / TRAINED_FRAME, trial.place / "aside"
    training = trial.start_to_second_epoch()
    path.rename(aside)
    answer = trial.ended(training)
    aside.rename(path)
    return [*answer, trial.then()]


def spoiled_frame(trial: Trial) -> list[str]:
    """A colour file becomes noise; it is put back only after the command was tried."""
    trial.own_data()
    path = trial.root / TRAINED_FRAME
    content = path.read_bytes()
    training = trial.start_to_second_epoch()
    path.write_bytes(random.Random(0).randbytes(len(content)))
    answer = trial.ended(training)
    refused = trial.start()
    code = refused.end()
    path.write_bytes(content)
    return [*answer, f"exit code {code} ({trial.line_of(refused)}); with the file back it {trial.then()}"]


def killed_worker(trial: Trial) -> list[str]:
    """One of two processes that load data."""
    trial.more.append("data.workers=2")
    training = trial.start_to_second_epoch()
    os.kill(training.workers()[0], signal.SIGKILL)
    return [*trial.ended(training), trial.then()]


def killed_worker_of_the_test(trial: Trial) -> list[str]:
    """The same after the last epoch, while the best checkpoint is evaluated."""
    trial.more.append("data.workers=2")
    training = trial.start()
    training.until(lambda: len(training.workers()) == 4)
    before = set(training.workers())
    training.until(lambda: bool(set(training.workers()) - before))
    os.kill(min(set(training.workers()) - before), signal.SIGKILL)
    return [*trial.ended(training), trial.then()]


def little_shared_memory(trial: Trial) -> list[str]:
    """A /dev/shm of 64 kB, seen by this process alone."""
    trial.more.append("data.workers=2")
    _needs_root()
    own = ["unshare", "--mount", "sh", "-c", 'mount -t tmpfs -o size=64k tmpfs /dev/shm && exec "$@"', "sh"]
    return [*trial.ended(trial.start(before=own)), trial.then()]


def damaged(trial: Trial, damage: Callable[[Path], None], *names: str) -> list[str]:
    """Files change after a training was killed in its second epoch."""
    trial.start_to_second_epoch().close()
    for name in names:
        damage(trial.run / name)
    return _told_by_the_next(trial)


def damaged_end(trial: Trial, damage: Callable[[Path], None], *names: str) -> list[str]:
    """Files change after a training finished."""
    if trial.start().end():
        raise LostError("the training failed before the fault")
    for name in names:
        damage(trial.run / name)
    return _told_by_the_next(trial)


def _told_by_the_next(trial: Trial) -> list[str]:
    """The first session cannot say anything of what is done to its files afterwards."""
    training = trial.start()
    answer = trial.ended(training)
    if answer[0] != "0":
        return [*answer, f"EXIT CODE {answer[0]}"]
    if "finished before" in training.said:
        return [*answer, f"this was it: showed the table of the finished run; {trial.compared()}"]
    return [*answer, f"this was it: {trial.way_of(training)}{trial.compared()}"]


def truncated(path: Path) -> None:
    """Cut to its first half."""
    os.truncate(path, path.stat().st_size // 2)


def emptied(path: Path) -> None:
    """Cut to nothing, as after a power cut."""
    os.truncate(path, 0)


def noised(path: Path) -> None:
    """Its first byte is no text any more."""
    path.write_bytes(b"\xff" + path.read_bytes()[1:])


def flipped(path: Path) -> None:
    """One bit in the middle changed."""
    with path.open("r+b") as file:
        file.seek(path.stat().st_size // 2)
        byte = file.read(1)[0]
        file.seek(-1, os.SEEK_CUR)
        file.write(bytes([byte ^ 1]))


def no_wandb(trial: Trial, kind: str) -> list[str]:
    """W&B is asked for and not to be had: without a key, or its server `refuses` or is `silent`."""
    trial.more += ["logger=wandb", "logger.offline=false"]
    environment = {"HOME": str(trial.place), "WANDB_API_KEY": "0123456789" * 4}
    environment |= {"WANDB_ERROR_REPORTING": "false", "NETRC": str(trial.place / "none")}
    server = trial.keep.enter_context(socket.socket())
    server.bind(("127.0.0.1", 0))
    if kind == "silent":
        server.listen()
    environment["WANDB_BASE_URL"] = f"http://127.0.0.1:{server.getsockname()[1]}"
    if kind == "no key":
        del environment["WANDB_API_KEY"]
    begin = time.monotonic()
    training = trial.start(environment)
    answer = trial.ended(training)
    kept = len(list((trial.run / "wandb").glob("offline-run-*/*.wandb")))
    after = f"{time.monotonic() - begin:.0f} s in all, {kept} offline run kept; {trial.compared()}"
    return [*answer, f"not needed: {after}"]


def jumping_clock(trial: Trial) -> list[str]:
    """By hours, forward and back, every few times that it is read."""
    (trial.place / "clock").mkdir()
    (trial.place / "clock" / "sitecustomize.py").write_text(JUMPING_CLOCK)
    begin, begun = time.monotonic(), datetime.now().astimezone()
    training = trial.start({"PYTHONPATH": str(trial.place / "clock")})
    code = training.end()
    taken, status = time.monotonic() - begin, read_plain(trial.run / STATUS)
    stamps = [datetime.fromisoformat(status[name]) for name in ("started", "updated")]
    if all(abs((stamp - begun).total_seconds()) < LONGEST for stamp in stamps):
        raise NotMadeError("the clock did not jump")
    lines = [line for line in training.said.splitlines() if line.startswith("epoch ")]
    paces = [float(line.split(" s an epoch")[0].split()[-1]) for line in lines]
    with (trial.run / "metrics.csv").open(newline="") as file:
        epochs = [row["epoch"] for row in csv.DictReader(file)]
    sane = 0 < status["seconds"] < taken and all(0 < pace < taken for pace in paces)
    sane = sane and epochs == [str(epoch) for epoch in range(EPOCHS)]
    seconds = "seconds, pace and epochs are right" if sane else "WRONG SECONDS, PACE OR EPOCHS"
    answer = [str(code), trial.line_of(training), trial.state()]
    return [*answer, f"not needed: {seconds}, stamps are the clock's; {trial.compared()}"]


def two_on_one_folder(trial: Trial) -> list[str]:
    """The second is told to stay away, and disturbs nothing."""
    first = trial.start_to_second_epoch()
    first.send(signal.SIGSTOP)  # else it is done before the second has begun
    second = trial.start()
    code, said = second.end(), trial.line_of(second)
    first.send(signal.SIGCONT)
    state = trial.state()
    answer = [f"{code}, the first {first.end()}", said, state]
    return [*answer, f"the first: {trial.compared()}"]


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
    ("W&B without a key", "`logger.offline=false`, no key", partial(no_wandb, kind="no key")),
    ("W&B refuses", "`logger.offline=false`, a closed port", partial(no_wandb, kind="refuses")),
    (
        "W&B is silent",
        "`logger.offline=false`, a server that never answers",
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


def row(cells: Sequence[str]) -> str:
    """Of a table in Markdown."""
    return f"| {' | '.join(cell.replace('|', '/').replace(chr(10), ' ') for cell in cells)} |"


def wrong(cells: Sequence[str]) -> bool:
    """Whether a row shouts."""
    shouts = ("STACK", "EXIT", "DIFFERENT", "LEFT", "FAILED", "WRONG", "UNFINISHED")
    return any(shout in cell for cell in cells for shout in shouts)


if __name__ == "__main__":
    sys.exit(main())
