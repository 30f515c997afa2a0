"""Quartiles of one quantity over another."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np


@dataclass(frozen=True)
class Quartiles:
    """Lower quartile, median and upper quartile in each bin; NaN where a bin has too few values."""

    lower: np.ndarray
    median: np.ndarray
    upper: np.ndarray
    counts: np.ndarray


def quartiles(values: np.ndarray, against: np.ndarray, edges: np.ndarray, fewest: int = 1) -> Quartiles:
    """Quartiles of `values` in bins of `against`, by linear interpolation.

    Args:
        values: one value a pixel.
        against: quantity that is binned; bin i holds edges[i] <= x < edges[i + 1].
        edges: ascending, one more than bins.
        fewest: smallest number of values that a bin needs.
    """
    order = np.argsort(against, kind="stable")
    cuts = np.searchsorted(against[order], edges)
    parts = [values[order[low:high]] for low, high in pairwise(cuts)]
    nothing = np.full(3, np.nan)
    rows = [np.quantile(part, [0.25, 0.5, 0.75]) if len(part) >= fewest else nothing for part in parts]
    lower, median, upper = np.array(rows).T
    return Quartiles(lower, median, upper, np.diff(cuts))
