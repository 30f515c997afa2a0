"""The trainings of one fault, held against an undisturbed one."""

import re
import shutil
import socket
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch

from col3d.io.run_files import RESULT, STATUS, read_job, read_plain
from tests.faults.training import Training
from tests.helpers.tiny_options import SMALL, SMALLEST

EPOCHS = 3
OPTIONS = (
    "model=bts",
    SMALL,
    *SMALLEST,
    "callbacks.checkpoint_minutes=0",
    "trainer.accelerator=cpu",
    f"trainer.max_epochs={EPOCHS}",
)
"""The smallest training that has every part; it saves after every step."""
SAID = ("error:", "note:", "stopped;")
SAME = "the same weights and tables to the bit"


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
        return re.sub(r"(?<![\d/])\d{4,}", "N", text).replace(f" on {socket.gethostname()}", " on HOST")

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


def row(cells: Sequence[str]) -> str:
    """Of a table in Markdown."""
    return f"| {' | '.join(cell.replace('|', '/').replace(chr(10), ' ') for cell in cells)} |"
