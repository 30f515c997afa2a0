"""Relief of the wall above the smooth tube: folds, bumps, swellings and the cecal pole, in mm."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from col3d.phantom.segments import Segment
from col3d.phantom.value_noise import random_lattice, value_noise


@dataclass(frozen=True)
class Fold:
    """One haustral fold across the tube."""

    at: float
    towards: float
    reach: float
    height: float
    width: float
    tilt: float


def place_folds(segment: Segment, random: np.random.Generator) -> list[Fold]:
    """Place folds at uneven distances, each rotated from the previous one by about a third of a circle."""
    folds, at, towards = [], 0.5 * segment.fold_spacing, random.uniform(0, 2 * np.pi)
    while at < segment.length - 4:
        folds.append(
            Fold(
                at=at,
                towards=towards,
                reach=segment.fold_reach * random.uniform(0.75, 1.2),
                height=segment.radius * segment.fold_height * random.uniform(0.6, 1.15),
                width=segment.fold_width * random.uniform(0.776, 1.224),
                tilt=random.uniform(-3.0, 3.0),
            )
        )
        at += segment.fold_spacing * random.uniform(0.65, 1.35)
        towards += 2 * np.pi / 3 * random.choice([1, 2]) + random.uniform(-0.4, 0.4)
    return folds


def fold_heights(folds: list[Fold], rows: np.ndarray, theta: np.ndarray) -> Float[np.ndarray, "n k"]:
    """Height of the folds: Gaussian profiles along the tube that fade out around it, and add up."""
    total = np.zeros((len(rows), len(theta)))
    for fold in folds:
        near = np.abs(rows - fold.at) < 5 * fold.width + 3
        off = np.angle(np.exp(1j * (theta - fold.towards)))
        around = np.clip(1 - (off / fold.reach) ** 2, 0, None) ** 1.5 + 0.12
        crest = fold.at + fold.tilt * np.cos(theta - fold.towards)
        across = (rows[near, None] - crest) / (fold.width * (0.8 + 0.4 * around))
        total[near] += fold.height * around * np.exp(-0.5 * across**2)
    return total


def bumps(
    segment: Segment, rows: np.ndarray, theta: np.ndarray, radius: np.ndarray, random: np.random.Generator
) -> Float[np.ndarray, "n k"]:
    """Height of polyps and swellings: round domes, flat plateaus with steep rims, and lobed shapes."""
    total = np.zeros_like(radius)
    for _ in range(int(segment.length / 14)):
        at, towards = random.uniform(-0.4 * segment.radius, segment.length), random.uniform(0, 2 * np.pi)
        size = random.choice([random.uniform(1.5, 3.5), random.uniform(5.0, 9.0)])
        height = size * random.uniform(0.3, 0.75) if size < 4 else size * random.uniform(0.15, 0.4)
        steepness, lobes, phase = (
            random.choice([1.5, 1.5, 4.0]),
            random.choice([0.0, 0.0, 0.25]),
            random.uniform(0, 6),
        )
        near = np.abs(rows - at) < 2.2 * size
        off = radius[near] * np.angle(np.exp(1j * (theta - towards)))
        along = rows[near, None] - at
        distance = (along**2 + off**2) / size**2
        shape = 1 + lobes * np.sin(4 * along / size + phase) * np.sin(4 * off / size + phase)
        total[near] += height * shape * np.exp(-(distance**steepness))
    return total


def swell(segment: Segment, base: np.ndarray, random: np.random.Generator) -> Float[np.ndarray, "n k"]:
    """Height of the soft unevenness of the whole wall, at two scales."""
    points = base.reshape(-1, 3)
    coarse = value_noise(points, segment.swell_size, random_lattice(random, 1))
    fine = value_noise(points, 0.32 * segment.swell_size, random_lattice(random, 1))
    return segment.swell * (coarse + 0.14 * fine).astype(np.float64).reshape(base.shape[:2])


def wrinkles(
    segment: Segment, rows: np.ndarray, theta: np.ndarray, random: np.random.Generator
) -> Float[np.ndarray, "n k"]:
    """Height of fine rings around the tube, with uneven distances and varying strength."""
    spacing, phase = random.uniform(2.5, 6.0), random.uniform(0, 2 * np.pi, 4)
    wave = 2 * np.pi * rows[:, None] / spacing + 2.5 * np.sin(rows / 11 + phase[0])[:, None]
    wave = wave + 1.5 * np.sin(theta + phase[1])
    strength = 0.5 + 0.5 * np.sin(rows / 19 + phase[2])[:, None] * np.sin(2 * theta + phase[3])
    return segment.wrinkle * strength * np.sin(wave)


def pouch(rows: np.ndarray, theta: np.ndarray, segment: Segment) -> Float[np.ndarray, "n k"]:
    """Height of the cecal pole: ridges that meet at it, and the dent of the appendix."""
    radius = segment.radius
    pole = -0.5 * np.pi * radius
    from_pole = (rows - pole)[:, None]
    arms = np.cos(segment.lobes * theta) * 0.5 + 0.5
    ridge = (
        segment.arm
        * arms**segment.arm_sharpness
        * np.exp(-0.5 * ((from_pole - 0.55 * radius) / (0.3 * radius)) ** 2)
    )
    dent = -4.0 * np.exp(-0.5 * (from_pole / 2.6) ** 2) + 1.6 * np.exp(-0.5 * ((from_pole - 6) / 2.2) ** 2)
    return ridge + dent
