"""Means over frames and their bootstrap intervals; whole videos are drawn, as frames of a video are alike."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from col3d.reports.runs import Run

DRAWS, LEVEL, GENERATOR_SEED = 2000, 0.95, 0


@dataclass(frozen=True)
class Sample:
    """Values of a metric, with the seed, video and frame of each."""

    values: np.ndarray
    seeds: np.ndarray
    videos: np.ndarray
    frames: np.ndarray


@dataclass(frozen=True)
class Interval:
    """The middle 95 % of the bootstrap; `over` names what was resampled."""

    low: float
    high: float
    over: str


@dataclass(frozen=True)
class Difference:
    """Mean over the frames that both have of our value minus the baseline's."""

    mean: float
    interval: Interval | None
    pairs: int
    note: str


def sample_of(runs: Sequence[Run], metric: str) -> Sample:
    """All frames of all repetitions that have a value."""
    values = np.concatenate([run.values(metric) for run in runs])
    seeds = np.repeat([int(run.summary["seed"]) for run in runs], [len(r.frames["frame"]) for r in runs])
    videos, frames = (np.concatenate([run.frames[name] for run in runs]) for name in ("video", "frame"))
    having = np.isfinite(values)
    return Sample(values[having], seeds[having], videos[having], frames[having])


def mean_and_std(sample: Sample) -> tuple[float, float]:
    """Mean and standard deviation over frames: of the population, divided by n (numpy's ddof=0)."""
    return float(sample.values.mean()), float(sample.values.std())


def cluster_bootstrap(sample: Sample, draws: int = DRAWS, seed: int = GENERATOR_SEED) -> Interval | None:
    """The 95 % percentile interval of the mean over frames.

    Videos are drawn with replacement, and so are seeds, independently of each other; the frames of a drawn
    video stay together. A single video, or a single seed, is not drawn anew.

    Args:
        sample: values of the metric, at least one.
        draws: number of resampled means.
        seed: seed of the random generator.

    Returns:
        The interval, or None where there is one video and one seed.
    """
    sums, counts = _by_seed_and_video(sample)
    seeds, videos = counts.shape
    if (seeds, videos) == (1, 1):
        return None
    random = np.random.default_rng(seed)
    drawn = [random.multinomial(n, np.full(n, 1 / n), size=draws) for n in (seeds, videos)]
    total, number = (np.einsum("ds,sv,dv->d", drawn[0], table, drawn[1]) for table in (sums, counts))
    tail = (1 - LEVEL) / 2
    low, high = np.quantile(total[number > 0] / number[number > 0], [tail, 1 - tail])
    over = "videos and seeds" if min(seeds, videos) > 1 else "videos" if videos > 1 else "seeds"
    return Interval(float(low), float(high), over)


def _by_seed_and_video(sample: Sample) -> tuple[np.ndarray, np.ndarray]:
    """Sums and numbers of values, each (seeds, videos)."""
    seeds, seed_of = np.unique(sample.seeds, return_inverse=True)
    videos, video_of = np.unique(sample.videos, return_inverse=True)
    shape, cell = (len(seeds), len(videos)), seed_of * len(videos) + video_of
    size = len(seeds) * len(videos)
    sums = np.bincount(cell, sample.values, minlength=size)
    return sums.reshape(shape), np.bincount(cell, minlength=size).reshape(shape)


def paired_difference(ours: Sample, baseline: Sample) -> Difference | None:
    """Mean difference on the frames, and by the seeds, that both have; None where they share no frame.

    Where no seed is shared, each frame's mean over the seeds is compared, and only videos are drawn.
    """
    note, shared = "", np.intersect1d(ours.seeds, baseline.seeds)
    if len(shared) == 0:
        ours, baseline, note = _mean_of_seeds(ours), _mean_of_seeds(baseline), "no seed in common"
    elif len(shared) < max(len(np.unique(ours.seeds)), len(np.unique(baseline.seeds))):
        note = f"seeds {', '.join(map(str, shared))} alone"
    baseline_values = dict(zip(_keys(baseline), baseline.values, strict=True))
    keys = [(i, key) for i, key in enumerate(_keys(ours)) if key in baseline_values]
    if not keys:
        return None
    kept = [i for i, _ in keys]
    values = ours.values[kept] - np.array([baseline_values[key] for _, key in keys])
    pairs = Sample(values, ours.seeds[kept], ours.videos[kept], ours.frames[kept])
    return Difference(float(values.mean()), cluster_bootstrap(pairs), len(kept), note)


def _keys(sample: Sample) -> list[tuple[int, str, int]]:
    return list(zip(sample.seeds.tolist(), sample.videos.tolist(), sample.frames.tolist(), strict=True))


def _mean_of_seeds(sample: Sample) -> Sample:
    """Mean over the seeds of each frame: one value a frame."""
    by_frame: dict[tuple[str, int], list[float]] = {}
    for (_, video, frame), value in zip(_keys(sample), sample.values.tolist(), strict=True):
        by_frame.setdefault((video, frame), []).append(value)
    videos, frames = (np.array(column) for column in zip(*by_frame, strict=True))
    return Sample(
        np.array([np.mean(v) for v in by_frame.values()]), np.zeros(len(by_frame), np.int64), videos, frames
    )
