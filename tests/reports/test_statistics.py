"""Means, bootstrap and paired differences: against slow loops, laws and cases that are known exactly."""

import numpy as np
import pytest

from col3d.reports.statistics import (
    Sample,
    cluster_bootstrap,
    mean_and_std,
    paired_difference,
)


def sample(seeds: int = 3, videos: int = 4, frames: int = 5, start: int = 0, seed: int = 0) -> Sample:
    """Videos of unequal length and level."""
    random = np.random.default_rng(seed)
    cells = [(s, v, f) for s in range(start, start + seeds) for v in range(videos) for f in range(frames + v)]
    values = np.array([v + 0.1 * s + random.normal() for s, v, _ in cells])
    s, v, f = (np.array(column) for column in zip(*cells, strict=True))
    return Sample(values, s, np.array([f"video_{i}" for i in v]), f)


def slow_bootstrap(given: Sample, draws: int, seed: int) -> tuple[float, float]:
    """Draws seeds and videos by name, and gathers frames one by one."""
    random = np.random.default_rng(seed)
    seeds, videos = sorted(set(given.seeds.tolist())), sorted(set(given.videos.tolist()))
    means = []
    for _ in range(draws):
        drawn_seeds = random.choice(seeds, len(seeds))
        drawn_videos = random.choice(videos, len(videos))
        gathered: list[float] = []
        for s in drawn_seeds:
            for v in drawn_videos:
                gathered += given.values[(given.seeds == s) & (given.videos == v)].tolist()
        means.append(sum(gathered) / len(gathered))
    means.sort()
    low, high = np.percentile(means, [2.5, 97.5])
    return float(low), float(high)


@pytest.mark.parametrize(("seeds", "videos"), [(3, 4), (1, 6), (5, 1)])
def test_bootstrap_is_that_of_a_slow_loop(seeds: int, videos: int) -> None:
    given = sample(seeds, videos)
    found = cluster_bootstrap(given, draws=20000)
    low, high = slow_bootstrap(given, 4000, seed=5)
    assert found is not None
    width = high - low
    assert found.low == pytest.approx(low, abs=0.06 * width)
    assert found.high == pytest.approx(high, abs=0.06 * width)


def test_bootstrap_of_two_videos_is_known_exactly() -> None:
    """Means of 0 and 1 with one frame each are 0, 1/2, 1 with probabilities 1/4, 1/2, 1/4."""
    two = Sample(np.array([0.0, 1.0]), np.zeros(2, int), np.array(["a", "b"]), np.zeros(2, int))
    found = cluster_bootstrap(two)
    assert found is not None
    assert (found.low, found.high, found.over) == (0.0, 1.0, "videos")


def test_interval_holds_the_truth_about_as_often_as_it_says() -> None:
    """30 videos whose levels are normal: the percentile interval is a little short of 95 %."""
    random, hits = np.random.default_rng(0), 0
    for trial in range(300):
        levels = np.repeat(random.normal(size=30), 4)
        given = Sample(levels, np.zeros(120, int), np.repeat(np.arange(30), 4).astype(str), np.arange(120))
        found = cluster_bootstrap(given, draws=400, seed=trial)
        assert found is not None
        hits += found.low <= 0.0 <= found.high
    assert 0.89 <= hits / 300 <= 0.98


def test_frames_of_a_video_are_not_taken_for_independent() -> None:
    """The same frame shown a hundred times says no more than once."""
    once, often = sample(2, 5, 1), sample(2, 5, 1)
    often = Sample(
        *(np.repeat(column, 100) for column in (often.values, often.seeds, often.videos, often.frames))
    )
    found, expected = cluster_bootstrap(often), cluster_bootstrap(once)
    assert found is not None
    assert expected is not None
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high))


def test_what_is_drawn_is_said_and_one_cluster_gives_none() -> None:
    over = {(s, v): cluster_bootstrap(sample(s, v)) for s in (1, 3) for v in (1, 4)}
    assert over[1, 1] is None
    assert {k: i.over for k, i in over.items() if i} == {
        (1, 4): "videos",
        (3, 1): "seeds",
        (3, 4): "videos and seeds",
    }
    assert cluster_bootstrap(sample()) == cluster_bootstrap(sample())


def test_std_is_that_of_the_population() -> None:
    given = Sample(np.array([1.0, 3.0]), np.zeros(2, int), np.array(["a", "a"]), np.arange(2))
    assert mean_and_std(given) == (2.0, 1.0)


def test_a_run_does_not_differ_from_itself() -> None:
    found = paired_difference(sample(), sample())
    assert found is not None
    assert found.interval is not None
    assert (found.mean, found.interval.low, found.interval.high, found.note) == (0.0, 0.0, 0.0, "")
    assert found.pairs == len(sample().values)


def test_pairs_are_by_video_frame_and_seed() -> None:
    """A constant offset comes out exactly, however the rows lie and whatever else one of the two has."""
    base = sample()
    order = np.random.default_rng(1).permutation(len(base.values))
    shuffled = Sample(base.values[order] + 0.5, base.seeds[order], base.videos[order], base.frames[order])
    kept = shuffled.frames != 2
    part = Sample(*(c[kept] for c in (shuffled.values, shuffled.seeds, shuffled.videos, shuffled.frames)))
    found = paired_difference(part, base)
    assert found is not None
    assert found.interval is not None
    assert (found.mean, found.interval.low, found.interval.high) == pytest.approx((0.5, 0.5, 0.5))
    assert found.pairs == kept.sum() < len(base.values)


def test_seeds_that_one_lacks_are_not_compared() -> None:
    found = paired_difference(sample(3, start=1), sample(3))
    assert found is not None
    assert found.note == "seeds 1, 2 alone"
    both = sample(3).seeds >= 1
    assert found.pairs == both.sum()


def test_without_a_seed_in_common_means_over_seeds_are_compared() -> None:
    ours, theirs = sample(2, start=10), sample(3)
    found = paired_difference(ours, theirs)
    assert found is not None
    assert found.interval is not None
    assert (found.note, found.interval.over) == ("no seed in common", "videos")
    assert found.pairs == len(ours.values) // 2
    assert found.mean == pytest.approx(ours.values.mean() - theirs.values.mean())


def test_nothing_in_common_is_no_difference() -> None:
    ours, theirs = sample(), sample()
    assert (
        paired_difference(ours, Sample(theirs.values, theirs.seeds, theirs.videos, theirs.frames + 99))
        is None
    )
