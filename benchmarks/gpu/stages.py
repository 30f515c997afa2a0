"""Stages in the order of their worth, each with a limit; one that fails does not end the others."""

import gc
import signal
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType

import torch

from benchmarks.gpu.parity import SOURCES, parity
from benchmarks.gpu.results import STAGES, Record, Results
from benchmarks.gpu.setting import NAMES, Setting
from col3d.errors import DataError

GROUPS = ("parity", "speed", "inside", "loader", "training", "compiled", "largest")
NOT_RUN = "not run"
LEAST_SECONDS = 2.0
"""A stage with less time left is not begun."""


class StageTimeoutError(Exception):
    """A stage has used up its time."""


@dataclass(frozen=True)
class Stage:
    """Something that is measured on its own.

    Attributes:
        group: by which it is chosen.
        item: what it is measured on.
        seconds: its limit.
        measure: setting and item -> results, one by one.
    """

    group: str
    item: str
    seconds: float
    measure: Callable[[Setting, str], Iterable[Record]]

    @property
    def name(self) -> str:
        """Group and item."""
        return f"{self.group}:{self.item}"


def stages(chosen: Sequence[str] = GROUPS) -> list[Stage]:
    """Those of some groups, or `group:item`: what proves most in least time comes first.

    Raises:
        DataError: there is no such stage.
    """
    found = [Stage("parity", source, 20, parity) for source in SOURCES]
    first, second, *others = NAMES
    found += [Stage("speed", first, 40, _speed), Stage("speed", second, 60, _speed)]
    found += [Stage("inside", first, 30, _inside)]
    found += [Stage("loader", first, 90, _loader), Stage("training", first, 240, _training)]
    found += [Stage("compiled", first, 150, _compiled), Stage("largest", first, 30, _largest)]
    found += [Stage("speed", name, 25, _speed) for name in others]
    known = {*GROUPS, *(stage.name for stage in found)}
    if unknown := sorted(set(chosen) - known):
        raise DataError(f"--only: expected names of {', '.join(sorted(known))}; got {', '.join(unknown)}")
    return [stage for stage in found if {stage.group, stage.name} & set(chosen)]


def run_stages(chosen: Iterable[Stage], setting: Setting, results: Results, until: float) -> int:
    """Run one after the other until a moment of `time.perf_counter`.

    Returns:
        How many failed.
    """
    failed = 0
    for stage in chosen:
        start = time.perf_counter()
        row: Record = {"table": STAGES, "stage": stage.group, "of": stage.item}
        seconds = min(stage.seconds, until - start)
        if seconds < LEAST_SECONDS:
            row["outcome"] = f"{NOT_RUN}: no time is left"
        else:
            row["outcome"] = _run(stage, setting, results, seconds)
            failed += not row["outcome"].startswith(("done", NOT_RUN))
        _release(setting.device)
        row["seconds"] = time.perf_counter() - start
        results.add(row)
        print(f"{stage.name}: {row['outcome']}, {row['seconds']:.1f} s", flush=True)
    return failed


def _run(stage: Stage, setting: Setting, results: Results, seconds: float) -> str:
    """How a stage ended."""
    try:
        with limited(seconds):
            for record in stage.measure(setting, stage.item):
                results.add(record)
    except DataError as error:  # what the stage needs is not there
        return f"{NOT_RUN}: {error}"
    except Exception as error:
        results.add_error(f"{stage.name}\n{traceback.format_exc()}")
        return f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
    return "done"


@contextmanager
def limited(seconds: float) -> Iterator[None]:
    """Raise `StageTimeoutError` in the main thread after some time."""

    def end(number: int, frame: FrameType | None) -> None:
        raise StageTimeoutError(f"it took longer than its limit of {seconds:.3g} s")

    before = signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def _release(device: torch.device) -> None:
    gc.collect()
    if device.type == "cuda":
        torch.cuda.empty_cache()


# Imported when they are run: a package that is missing ends one stage, not the command.


def _speed(setting: Setting, name: str) -> Iterable[Record]:
    from benchmarks.gpu.speed import speed

    return speed(setting, name)


def _inside(setting: Setting, name: str) -> Iterable[Record]:
    from benchmarks.gpu.inside import inside

    return inside(setting, name)


def _loader(setting: Setting, name: str) -> Iterable[Record]:
    from benchmarks.gpu.loader import loader

    return loader(setting, name)


def _compiled(setting: Setting, name: str) -> Iterable[Record]:
    from benchmarks.gpu.compiled import compiled

    return compiled(setting, name)


def _training(setting: Setting, name: str) -> Iterable[Record]:
    from benchmarks.gpu.trainings import trainings

    return trainings(setting, name)


def _largest(setting: Setting, name: str) -> Iterable[Record]:
    from benchmarks.gpu.largest import largest

    return largest(setting, name)
