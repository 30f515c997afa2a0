"""Accuracy and completeness of a surface compared with the true one."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from col3d.inference.fusion.surface import Surface

THRESHOLDS = (1.0, 2.0, 5.0)
"""Distances in mm within which points count as correct."""


@dataclass(frozen=True)
class Comparison:
    """Distances between two surfaces at points spread evenly over them, in mm.

    Attributes:
        accuracy: distances from points of the surface to the true one.
        completeness: distances from points of the true surface to the surface.
    """

    accuracy: Float[np.ndarray, " n"]
    completeness: Float[np.ndarray, " m"]

    def summary(self) -> dict[str, Any]:
        """Compute means and medians in mm, shares within 1, 2 and 5 mm, and their harmonic mean F."""
        scores: dict[str, Any] = {}
        for name, distances in (("accuracy", self.accuracy), ("completeness", self.completeness)):
            scores[f"{name}_mean_mm"] = float(distances.mean())
            scores[f"{name}_median_mm"] = float(np.median(distances))
        for threshold in THRESHOLDS:
            right, covered = ((d <= threshold).mean() for d in (self.accuracy, self.completeness))
            within = f"within_{threshold:g}_mm"
            scores[f"accurate_{within}"], scores[f"complete_{within}"] = float(right), float(covered)
            both = right + covered
            scores[f"f_score_{threshold:g}_mm"] = float(2 * right * covered / both) if both else 0.0
        return scores


def compare(surface: Surface, truth: Surface, spacing: float, seen: Surface | None = None) -> Comparison:
    """Compare a surface with the true one.

    Args:
        surface: the surface, in the same coordinates as the true one.
        truth: the true surface, to which accuracy is measured.
        spacing: distance in mm between the sampled points.
        seen: the visible part of the true surface, for completeness; all of it when absent.

    Raises:
        ValueError: one of them is empty.
    """
    whole = truth if seen is None else seen
    for name, given in (("surface", surface), ("truth", truth), ("seen", whole)):
        if not len(given.triangles):
            raise ValueError(f"{name}: holds no triangle")
    accuracy = truth.distance(surface.samples(spacing))
    return Comparison(accuracy, surface.distance(whole.samples(spacing)))
