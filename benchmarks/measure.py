"""All measurements as rows, with the targets that they are held to."""

from collections.abc import Mapping, Sequence

from benchmarks.frame_costs import frame_costs
from benchmarks.loading import Loading, loading_speeds
from benchmarks.report import Row, row
from benchmarks.timing import ratios
from benchmarks.training_step import STEP, laptop_options, step_costs
from benchmarks.worker_memory import Memory, worker_memory
from col3d.data.cache import StoredVideo
from col3d.data.datasets.frame_set import FrameSet

PAIRS = {
    ("store", "stand-in"): {"at_least": 50.0},
    ("store, decoded", "stand-in"): {},
    ("raw", "stand-in"): {"at_least": 4.0},
    ("raw, decoded", "stand-in"): {},
    ("copy", "store"): {"at_most": 2.0},
    ("copy, no loader", "store"): {},
}
"""Speeds that are compared. Loaders have targets; codes are decoded after them, on the batch's device."""
SHARE = {"at_most": 15.0}
"""Percent of a training step."""
GROWTH = {"at_most": 100.0}
"""MB of a worker after the first tenth of an epoch."""


def measured(frames: FrameSet, videos: Sequence[StoredVideo], loading: Loading, repeats: int) -> list[Row]:
    """Everything, one after the other.

    Args:
        frames: at full size.
        videos: of the store.
        loading: how.
        repeats: of everything but memory.
    """
    memory = worker_memory(videos, loading.batch_size)  # first, for a worker inherits what there is
    speeds = loading_speeds(frames, videos, loading, repeats)
    steps = step_costs(frames, laptop_options(), loading.device, repeats)
    costs = frame_costs(frames, loading.size_hw, repeats)
    return [
        *_speed_rows(speeds, loading),
        *_step_rows(steps),
        *[row("A frame of files on one core", name, "ms", values) for name, values in costs.items()],
        *_memory_rows(memory),
    ]


def _speed_rows(speeds: Mapping[str, list[float]], loading: Loading) -> list[Row]:
    table = f"Loading, {loading.workers} workers, batches of {loading.batch_size}"
    rows = [row(table, name, "frames/s", values) for name, values in speeds.items()]
    for (above, below), target in PAIRS.items():
        values = ratios(speeds[above], speeds[below])
        rows.append(row("Speeds over speeds", f"{above} / {below}", "x", values, **target))
    return rows


def _step_rows(steps: Mapping[str, list[float]]) -> list[Row]:
    table = "Augmentation beside a training step of preset=laptop"
    rows = [row(table, name, "ms", values) for name, values in steps.items()]
    for name, values in steps.items():
        if name != STEP:
            shares = [100 * share for share in ratios(values, steps[STEP])]
            rows.append(row(table, f"{name} / step", "%", shares, **SHARE))
    return rows


def _memory_rows(memory: Memory | None) -> list[Row]:
    """Empty where memory cannot be told."""
    if memory is None:
        return []
    table = f"Memory of a worker over an epoch that reads {memory.read:.0f} MB of a store"
    after = {"after a tenth": memory.tenths[0], "after all": memory.tenths[-1], "largest": memory.largest}
    rows = [row(table, name, "MB", [value]) for name, value in after.items()]
    return [*rows, row(table, "growth after a tenth", "MB", [memory.growth], **GROWTH)]
