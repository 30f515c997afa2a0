"""Real trainings of Col3D-MTL with cross-task consistency on the rendered colon, and again to the bit."""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import col3d
from benchmarks.gpu.results import Record
from benchmarks.gpu.setting import Setting
from col3d.errors import DataError
from col3d.io.run_files import RESULT, STATUS, read_plain
from col3d.reports.per_frame import read_per_frame

TABLE = "Trainings of Col3D-MTL with cross-task consistency on the rendered colon"
PAPER = (
    *("preset=paper", "trainer.max_epochs=2", "data.workers=8", "phantom.size=[324,405]"),
    *("phantom.frames_per_video=12", "model.pretrained=none", "callbacks.panels=0"),
)
"""The paper's network, size and batch, on so many frames that an epoch takes seconds."""
SMALLEST = (
    *("preset=smoke", "model.encoder=lcnet_035", "data/split=custom", "data.size=[64,80]"),
    *("data.split.train=[desc_t4_a]", "data.split.val=[trans_t1_a:0-1]", "data.split.test=[trans_t1_a:2-2]"),
    *("data.batch_size=1", "phantom.size=[64,80]", "phantom.frames_per_video=3", "callbacks.panels=0"),
)
"""Options that only show that all of it runs."""
LEAST = 1e-9
DDP = ("trainer.strategy=ddp", "trainer.devices=1")


@dataclass(frozen=True)
class Trained:
    """A finished training.

    Attributes:
        seconds: of the program, from its start to its end.
        abs_rel: absolute relative error on the test split.
        scores: every score of every test frame, in order.
    """

    seconds: float
    abs_rel: float
    scores: list[float]

    def furthest(self, other: "Trained") -> float:
        """The largest difference of a score relative to the other's, in percent."""
        ours, theirs = np.array(self.scores), np.array(other.scores)
        gaps = np.abs(ours - theirs) / np.maximum(np.abs(theirs), LEAST)
        return float(100 * np.max(gaps, where=~np.isnan(theirs), initial=0.0))


class Programs:
    """Starts the program as users do, in a folder where data and runs go."""

    def __init__(self, setting: Setting, folder: Path) -> None:
        options = SMALLEST if setting.quick else PAPER
        accelerator = "gpu" if setting.device.type == "cuda" else "cpu"
        self.options = (*options, f"trainer.accelerator={accelerator}", "trainer.deterministic=warn")
        self.folder = folder

    def train(self, name: str, *more: str) -> Trained:
        """Train to the end; a run that was stopped goes on."""
        start = time.perf_counter()
        code = self._begin(name, more).wait()
        if code != 0:
            raise RuntimeError(f"exit code {code}: {self._log(name).read_text()[-2000:]}")
        return self._trained(name, time.perf_counter() - start)

    def stop(self, name: str) -> None:
        """Begin a training and stop it by SIGTERM once its first epoch is over."""
        run = self.folder / name
        process = self._begin(name)
        try:
            while process.poll() is None and read_plain(run / STATUS).get("epoch", 0) < 1:
                time.sleep(0.01)
        finally:
            process.terminate()
            process.wait()
        if (run / RESULT).is_file():
            raise DataError("the training was over before it could be stopped")

    def _begin(self, name: str, more: tuple[str, ...] = ()) -> subprocess.Popen[bytes]:
        call = [sys.executable, "-m", "col3d", "train", *self.options, *more, f"hydra.run.dir={name}"]
        home = str(Path(col3d.__file__).parents[1])
        path = os.pathsep.join([home, *filter(None, [os.environ.get("PYTHONPATH")])])
        environment = {**os.environ, "PYTHONPATH": path}
        with self._log(name).open("ab") as log:
            return subprocess.Popen(call, cwd=self.folder, env=environment, stdout=log, stderr=log)

    def _log(self, name: str) -> Path:
        return self.folder / f"{name}.log"

    def _trained(self, name: str, seconds: float) -> Trained:
        summary = read_plain(self.folder / name / "summary.json")
        rows = read_per_frame(self.folder / name / "per_frame.csv")
        scores = [float(row[metric] or "nan") for row in rows for metric in summary["metrics"]]
        return Trained(seconds, float(summary["metrics"]["abs_rel"]), scores)


def trainings(setting: Setting, item: str) -> Iterator[Record]:
    """A training, the same again, the same stopped and gone on with, and the same under DDP."""
    with tempfile.TemporaryDirectory(prefix="trainings-") as folder:
        programs = Programs(setting, Path(folder))
        first = programs.train("first")
        yield _row("as it is, with the rendering", first, first)
        yield _row("again", programs.train("again"), first)
        programs.stop("stopped")
        yield _row("stopped after an epoch and gone on with", programs.train("stopped"), first)
        yield _row("DDP with one process", programs.train("ddp", *DDP), first)


def _row(what: str, trained: Trained, first: Trained) -> Record:
    furthest = trained.furthest(first)
    return {
        "table": TABLE,
        "what": what,
        "s": trained.seconds,
        "AbsRel": trained.abs_rel,
        "furthest score from the first, %": furthest,
        "": furthest == 0,
    }
