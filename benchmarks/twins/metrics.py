"""A twin of the published evaluation, for timing alone: numpy, frame by frame, in float32 as it comes."""

import numpy as np
from numpy.typing import NDArray

Map = NDArray[np.float32]
LEAST, MOST = 1e-3, 100.0
"""True depths in mm that count, both ends excluded; predictions are cut to the same range."""


def published_metrics(depth: Map, true_depth: Map, normals: Map, true_normals: Map) -> list[float]:
    """All 14 metrics of one frame: maps (h, w) in mm and (3, h, w)."""
    counts = np.logical_and(true_depth > LEAST, true_depth < MOST)
    guess = depth.copy()
    guess[guess < LEAST] = LEAST
    guess[guess > MOST] = MOST
    return [
        *depth_errors(true_depth[counts], guess[counts]),
        *normal_errors(true_normals[:, counts], normals[:, counts]),
    ]


def depth_errors(truth: Map, guess: Map) -> list[float]:
    """abs_rel, sq_rel, log10, rmse, rmse_log, silog and the three deltas of the counting pixels."""
    worst = np.maximum(truth / guess, guess / truth)
    deltas = [(worst < 1.25**k).mean() for k in (1, 2, 3)]
    rmse = np.sqrt(((truth - guess) ** 2).mean())
    rmse_log = np.sqrt(((np.log(truth) - np.log(guess)) ** 2).mean())
    abs_rel = np.mean(np.abs(truth - guess) / truth)
    sq_rel = np.mean((truth - guess) ** 2 / truth)
    gap = np.log(guess) - np.log(truth)
    silog = np.sqrt(np.mean(gap**2) - np.mean(gap) ** 2) * 100
    log10 = np.mean(np.abs(np.log10(guess) - np.log10(truth)))
    return [float(value) for value in (abs_rel, sq_rel, log10, rmse, rmse_log, silog, *deltas)]


def normal_errors(truth: Map, guess: Map) -> list[float]:
    """Mean and median angle in degrees and the shares below three limits, with the published 1e-3."""
    lengths = np.linalg.norm(truth, axis=0) * np.linalg.norm(guess, axis=0)
    cosine = np.clip((truth * guess).sum(axis=0) / (lengths + 1e-3), -1, 1)
    angles = np.degrees(np.arccos(cosine))
    shares = [(angles < limit).mean() for limit in (11.25, 22.5, 30.0)]
    return [float(value) for value in (angles.mean(), np.median(angles), *shares)]
