"""How near a surface comes to the true one, and how much of that it covers."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from col3d.inference.fusion.surface import Surface

THRESHOLDS = (1.0, 2.0, 5.0)
"""Millimetres within which points count as right."""


@dataclass(frozen=True)
class Comparison:
    """Distances between two surfaces at points spread evenly over them, in mm.

    Attributes:
        accuracy: from points of the surface to the true one.
        completeness: from points of the true surface to it.
    """

    accuracy: Float[np.ndarray, " n"]
    completeness: Float[np.ndarray, " m"]

    def summary(self) -> dict[str, Any]:
        """Means and medians in mm; shares of points within 1, 2 and 5 mm, and their harmonic mean F."""
        found: dict[str, Any] = {}
        for name, distances in (("accuracy", self.accuracy), ("completeness", self.completeness)):
            found[f"{name}_mean_mm"] = float(distances.mean())
            found[f"{name}_median_mm"] = float(np.median(distances))
        for threshold in THRESHOLDS:
            right, covered = ((d <= threshold).mean() for d in (self.accuracy, self.completeness))
            within = f"within_{threshold:g}_mm"
            found[f"accurate_{within}"], found[f"complete_{within}"] = float(right), float(covered)
            both = right + covered
            found[f"f_score_{threshold:g}_mm"] = float(2 * right * covered / both) if both else 0.0
        return found


def compare(surface: Surface, truth: Surface, spacing: float, seen: Surface | None = None) -> Comparison:
    """Compare a surface with the true one.

    Args:
        surface: in the same coordinates.
        truth: what accuracy is measured to.
        spacing: mm between the points at which distances are taken.
        seen: the part of the truth that there was to be seen, for completeness; all when absent.

    Raises:
        ValueError: one of them is empty.
    """
    whole = truth if seen is None else seen
    for name, given in (("surface", surface), ("truth", truth), ("seen", whole)):
        if not len(given.triangles):
            raise ValueError(f"{name}: holds no triangle")
    accuracy = truth.distance(surface.samples(spacing))
    return Comparison(accuracy, surface.distance(whole.samples(spacing)))
