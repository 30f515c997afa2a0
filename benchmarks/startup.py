"""Seconds from the shell to an answer and to a first training step."""

import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.report import Row, row

TRAIN = Path(__file__).parents[1] / "train.py"
TABLE = "From the shell"
FIRST_STEP = ("preset=smoke", "trainer.limit_train_batches=1", "trainer.max_epochs=1")


def startup_rows(repeats: int) -> list[Row]:
    """`train.py --help`, and `train.py preset=smoke` until the first step is saved."""
    with tempfile.TemporaryDirectory(prefix="startup-") as place:
        _first_step(Path(place), 0)  # renders the phantom
        helps = [_help() for _ in range(repeats)]
        steps = [_first_step(Path(place), number + 1) for number in range(repeats)]
    return [
        row(TABLE, "train.py --help", "s", helps, at_most=5.0),  # imports torch: classes are the options
        row(TABLE, "first training step of preset=smoke", "s", steps, at_most=12.0),
    ]


def _help() -> float:
    start = time.perf_counter()
    subprocess.run([sys.executable, str(TRAIN), "--help"], check=True, capture_output=True)
    return time.perf_counter() - start


def _first_step(place: Path, number: int) -> float:
    """Until last.ckpt is there: it is saved after the first step, which is later than the step itself."""
    run = place / f"run_{number}"
    options = [*FIRST_STEP, "callbacks.checkpoint_minutes=0", f"data.root={place / 'phantom'}"]
    command = [sys.executable, str(TRAIN), *options, f"hydra.run.dir={run}"]
    start = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        while not (run / "checkpoints" / "last.ckpt").exists():
            if process.poll() is not None:
                raise SystemExit(f"it ended before its first step: {' '.join(command)}")
            time.sleep(0.01)
        return time.perf_counter() - start
    finally:
        process.kill()
        process.wait()
