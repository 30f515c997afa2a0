"""Fair timing on a machine that others use too: what is compared takes turns, and spreads are told."""

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import torch

Work = Callable[[], object]


@dataclass(frozen=True)
class Spread:
    """Median of repeats, and the smallest and largest of them."""

    median: float
    low: float
    high: float


def spread_of(values: Sequence[float]) -> Spread:
    """Median and range of repeats."""
    return Spread(statistics.median(values), min(values), max(values))


def seconds_of(work: Work, device: torch.device | None = None) -> float:
    """How long a work takes, by the events of a GPU where one does it."""
    if device is None or device.type != "cuda":
        start = time.perf_counter()
        work()
        return time.perf_counter() - start
    begin, end = (torch.cuda.Event(enable_timing=True) for _ in range(2))
    begin.record()
    work()
    end.record()
    end.synchronize()
    return begin.elapsed_time(end) / 1000


def interleaved(
    works: Mapping[str, Work], repeats: int, device: torch.device | None = None
) -> dict[str, list[float]]:
    """Seconds that each work takes, by repeat; in each all take their turn, so that noise meets them alike.

    A round before the first is not counted: it starts workers, opens maps and fills caches.
    """
    seconds: dict[str, list[float]] = {name: [] for name in works}
    for repeat in range(repeats + 1):
        for name, work in works.items():
            taken = seconds_of(work, device)
            if repeat:
                seconds[name].append(taken)
    return seconds


def rates(count: int, seconds: Sequence[float]) -> list[float]:
    """Things a second."""
    return [count / second for second in seconds]


def ratios(above: Sequence[float], below: Sequence[float]) -> list[float]:
    """Of what was measured in the same repeat."""
    return [a / b for a, b in zip(above, below, strict=True)]
