"""Value noise: smooth random fields in space, interpolated from eight corners for each point."""

from itertools import product

import numpy as np
from jaxtyping import Float, Float32

PERIOD = 32
"""Number of cells after which the fields repeat, a power of two; far more than the width of a lumen."""

Lattice = Float32[np.ndarray, "channels cells"]


def random_lattice(random: np.random.Generator, channels: int) -> Lattice:
    """Draw uniform values in [-1, 1] at PERIOD^3 corners."""
    return random.uniform(-1.0, 1.0, (channels, PERIOD**3)).astype(np.float32)


def value_noise(
    points: Float[np.ndarray, "n 3"], cell: float, lattice: Lattice
) -> Float32[np.ndarray, "n c"]:
    """Interpolate the fields of a lattice at points, with continuous second derivatives.

    Args:
        points: positions in mm.
        cell: size of a lattice cell in mm, the scale of the field's detail.
        lattice: values at the corners.

    Returns:
        One value in [-1, 1] for each point and channel.
    """
    scaled = points.T.astype(np.float32) / np.float32(cell)
    low = np.floor(scaled)
    part = scaled - low
    fade = part * part * part * (part * (part * 6 - 15) + 10)
    corner = low.astype(np.intp)
    places = [(c & (PERIOD - 1), (c + 1) & (PERIOD - 1)) for c in corner]
    weights = [(1 - f, f) for f in fade]
    total = np.zeros((len(lattice), len(points)), np.float32)
    for x, y, z in product((0, 1), repeat=3):
        index = (places[0][x] * PERIOD + places[1][y]) * PERIOD + places[2][z]
        weight = weights[0][x] * weights[1][y] * weights[2][z]
        for channel, values in zip(total, lattice, strict=True):
            channel += weight * values.take(index)  # noqa: PLW2901 - adds in place, a row at a time
    return np.ascontiguousarray(total.T)


def smoothstep(low: float, high: float, x: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """Smooth step: 0 below `low`, 1 above `high` (or the reverse if low > high)."""
    t = np.clip((x - low) / (high - low), 0.0, 1.0)
    return t * t * (3 - 2 * t)
