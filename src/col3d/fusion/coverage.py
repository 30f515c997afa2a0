"""`coverage_mesh.obj` of a video of C3VD: the true wall, of which some faces were seen and others not."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from col3d.checks import DataError
from col3d.fusion.surface import Surface

NAMES = ("usemtl", "g", "o")
"""Lines of an OBJ file that name the faces after them."""
LABEL = re.compile(r"(?:^|\D)([01])$")
SEEN, UNSEEN = "0", "1"


@dataclass(frozen=True)
class Coverage:
    """The wall of a video in world coordinates, mm.

    Attributes:
        wall: all of it.
        seen: the part that the video has seen.
        told: whether the file says which part that is; where it does not, all counts as seen.
    """

    wall: Surface
    seen: Surface
    told: bool


def read_coverage(path: Path) -> Coverage:
    """Read the mesh.

    Faces are told apart by the material, group or object that they stand under, one of whose names is or
    ends in the number 0 for what was seen and 1 for what was not.

    Raises:
        DataError: the file is no mesh, or none of it was seen.
    """
    vertices: list[list[float]] = []
    triangles: list[list[int]] = []
    labels: list[tuple[str, ...]] = []
    current = dict.fromkeys(NAMES, "")
    try:
        with path.open(encoding="utf-8", errors="replace") as lines:
            for line in lines:
                key, *rest = line.split() or [""]
                if key == "v":
                    vertices.append([float(number) for number in rest[:3]])
                elif key in NAMES:
                    current[key] = next((m[1] for name in rest if (m := LABEL.search(name))), "")
                elif key == "f":
                    corners = [_place(corner, len(vertices)) for corner in rest]
                    fan = [[corners[0], a, b] for a, b in pairwise(corners[1:])]
                    triangles += fan
                    labels += [tuple(current.values())] * len(fan)
        corners_of = np.array(triangles, np.int64).reshape(-1, 3)
        wall = Surface(np.array(vertices, np.float64).reshape(-1, 3), corners_of)
        if not corners_of.size or corners_of.min() < 0 or corners_of.max() >= len(vertices):
            raise ValueError("no faces, or faces of vertices that are not there")
        if not np.isfinite(wall.vertices).all():
            raise ValueError("vertices that are not finite")
    except (OSError, ValueError, IndexError) as error:
        raise DataError(f"{path}: not a mesh in OBJ format ({error})") from None
    return _told_apart(path, wall, labels)


def _told_apart(path: Path, wall: Surface, labels: Sequence[tuple[str, ...]]) -> Coverage:
    """By the first kind of name that has both labels, or else only one of them."""
    kinds = [np.array(of_kind) for of_kind in zip(*labels, strict=True)]
    for wanted in ({SEEN, UNSEEN}, {UNSEEN}, {SEEN}):
        for found in kinds:
            if set(found.tolist()) == wanted:
                if wanted == {UNSEEN}:
                    raise DataError(f"{path}: all of its faces are marked as unseen")
                return Coverage(wall, Surface(wall.vertices, wall.triangles[found == SEEN]), True)
    return Coverage(wall, wall, False)


def _place(corner: str, count: int) -> int:
    """Index of a vertex, which OBJ counts from 1, or backwards from the last."""
    number = int(corner.split("/", maxsplit=1)[0])
    return number - 1 if number > 0 else count + number
