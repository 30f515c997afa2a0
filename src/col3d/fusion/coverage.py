"""`coverage_mesh.obj` of a video of C3VD: the true wall, of which some faces were seen and others not."""

from itertools import pairwise
from pathlib import Path

import numpy as np

from col3d.checks import DataError
from col3d.fusion.surface import Surface

NAMES = ("g", "o", "usemtl")
"""Lines of an OBJ file that name the faces after them."""
SEEN, UNSEEN = "0", "1"


def read_coverage(path: Path) -> tuple[Surface, Surface]:
    """The whole wall, and the part of it that the video has seen, in world coordinates, mm.

    Faces are told apart by the group, object or material that they stand under, whose name ends in 0 for
    what was seen and in 1 for what was not. In a file that does not tell them apart all count as seen.

    Raises:
        DataError: the file is no mesh.
    """
    vertices: list[list[float]] = []
    triangles: list[list[int]] = []
    labels: list[str] = []
    label = SEEN
    try:
        with path.open(encoding="utf-8", errors="replace") as lines:
            for line in lines:
                key, *rest = line.split() or [""]
                if key == "v":
                    vertices.append([float(number) for number in rest[:3]])
                elif key in NAMES:
                    label = UNSEEN if rest and rest[-1].endswith(UNSEEN) else SEEN
                elif key == "f":
                    corners = [_place(corner, len(vertices)) for corner in rest]
                    fan = [[corners[0], a, b] for a, b in pairwise(corners[1:])]
                    triangles += fan
                    labels += [label] * len(fan)
        corners_of = np.array(triangles, np.int64).reshape(-1, 3)
        found = Surface(np.array(vertices, np.float64).reshape(-1, 3), corners_of)
        if not corners_of.size or corners_of.min() < 0 or corners_of.max() >= len(vertices):
            raise ValueError("no faces, or faces of vertices that are not there")
    except (OSError, ValueError, IndexError) as error:
        raise DataError(f"{path}: not a mesh in OBJ format ({error})") from None
    seen = np.array(labels) == SEEN
    return found, Surface(found.vertices, found.triangles[seen]) if seen.any() else found


def _place(corner: str, count: int) -> int:
    """Index of a vertex, which OBJ counts from 1, or backwards from the last."""
    number = int(corner.split("/", maxsplit=1)[0])
    return number - 1 if number > 0 else count + number
