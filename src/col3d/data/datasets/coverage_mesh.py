"""`coverage_mesh.obj` of a video: the whole wall of its segment, and which faces the video observed.

C3VD's renderer writes all vertices in world coordinates, exactly two texture coordinates, `vt 0.0 0.0` and
`vt 1.0 1.0`, and triangles `f a/1 b/1 c/1` where a ray of some frame hit them, `f a/2 b/2 c/2` where none
did; no materials, groups or objects.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import numpy as np
from jaxtyping import Bool, Float, Int

from col3d.errors import DataError

COVERAGE_MESH = "coverage_mesh.obj"
OBSERVED, MISSED = 1, 2
"""Texture indices of faces."""
COORDINATES = {OBSERVED: (0.0, 0.0), MISSED: (1.0, 1.0)}
MATERIALS = {b"0": OBSERVED, b"1": MISSED}
"""Names of materials by which phantoms before version 4 mark their faces."""


@dataclass(frozen=True)
class CoverageMesh:
    """The wall of a video in world coordinates, mm.

    Attributes:
        vertices: coordinates of the vertices.
        triangles: indices of three vertices each.
        observed: which triangles the video has seen; None where the file does not say.
    """

    vertices: Float[np.ndarray, "n 3"]
    triangles: Int[np.ndarray, "t 3"]
    observed: Bool[np.ndarray, " t"] | None

    @property
    def seen(self) -> Int[np.ndarray, "s 3"]:
        """The triangles that the video has seen; all where the file does not say."""
        return self.triangles if self.observed is None else self.triangles[self.observed]


@dataclass
class _Lines:
    """Lines of a file by kind, their numbers not parsed yet."""

    vertices: list[bytes] = field(default_factory=list)
    textures: list[bytes] = field(default_factory=list)
    faces: list[bytes] = field(default_factory=list)
    before: list[int] = field(default_factory=list)
    """For each face, the number of vertices above it."""
    materials: list[int] = field(default_factory=list)
    """For each face, its state by its material: observed, missed, or 0."""


def read_coverage_mesh(path: Path) -> CoverageMesh:
    """Read the mesh, in the form of C3VD's renderer or of phantoms before version 4.

    Raises:
        DataError: the file is no mesh, its texture indices are no coverage, or none of it was observed.
    """
    try:
        with path.open("rb") as file:
            lines = _read(file)
        vertices = _table(lines.vertices, 3, "v")
        corners, textures, sides = _corners(lines)
        if len(corners) == 0 or corners.min() < 0 or corners.max() >= len(vertices):
            raise ValueError("no faces, or faces of vertices that are not there")
        if not np.isfinite(vertices).all():
            raise ValueError("vertices that are not finite")
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror})") from None
    except ValueError as error:
        raise DataError(f"{path}: not a mesh in OBJ format ({error})") from None
    labels = _labels(path, lines, textures, sides)
    triangles, of_face = _fans(corners, sides)
    observed = None if labels is None else (labels == OBSERVED)[of_face]
    if observed is not None and not observed.any():
        raise DataError(f"{path}: all of its faces are marked as missed")
    return CoverageMesh(vertices, triangles, observed)


def write_coverage_mesh(path: Path, mesh: CoverageMesh) -> None:
    """Write the mesh as C3VD's renderer does; without coverage, all of it is written as observed."""
    labels = np.ones(len(mesh.triangles), int)
    if mesh.observed is not None:
        labels = np.where(mesh.observed, OBSERVED, MISSED)
    with path.open("w", encoding="ascii") as file:
        file.writelines(f"v {x:.3f} {y:.3f} {z:.3f}\n" for x, y, z in mesh.vertices)
        file.writelines(f"vt {u} {v}\n" for u, v in COORDINATES.values())
        rows = zip((mesh.triangles + 1).tolist(), labels.tolist(), strict=True)
        file.writelines(f"f {a}/{label} {b}/{label} {c}/{label}\n" for (a, b, c), label in rows)


def _read(file: IO[bytes]) -> _Lines:
    """Sort lines by kind; numbers are parsed later, so that a million lines take a second."""
    lines, material = _Lines(), 0
    for line in file:
        key, _, rest = line.strip().partition(b" ")
        if key == b"f":
            lines.faces.append(rest)
            lines.before.append(len(lines.vertices))
            lines.materials.append(material)
        elif key == b"v":
            lines.vertices.append(rest)
        elif key == b"vt":
            lines.textures.append(rest)
        elif key == b"usemtl":
            material = MATERIALS.get(rest.strip(), 0)
    return lines


def _table(rows: Sequence[bytes], columns: int, key: str) -> np.ndarray:
    """Numbers of lines (n, columns); further numbers of a line are dropped."""
    width = len(rows[0].split()) if rows else columns
    values = _numbers(rows)
    if width < columns or values.size != width * len(rows):
        raise ValueError(f"lines {key} of {columns} numbers each were expected")
    return values.reshape(len(rows), width)[:, :columns]


def _numbers(rows: Iterable[bytes]) -> np.ndarray:
    text = b" ".join(rows)
    return np.array(text.split(), dtype="S").astype(np.float64) if text else np.empty(0)


def _corners(lines: _Lines) -> tuple[np.ndarray, np.ndarray | None, np.ndarray]:
    """Vertex of each corner, its texture index where corners have one, and how many corners each face has."""
    sides = np.array([len(face.split()) for face in lines.faces], np.int64)
    if len(sides) == 0 or sides.min() < 3:
        raise ValueError("faces of three corners or more were expected")
    first = lines.faces[0].split()[0]
    parts = first.count(b"/") + 1
    text = b" ".join(lines.faces).replace(b"//", b"/0/").replace(b"/", b" ")
    values = np.array(text.split(), dtype="S").astype(np.int64)
    if values.size != parts * sides.sum():
        raise ValueError("faces were expected whose corners are all written alike")
    values = values.reshape(-1, parts)
    before = np.repeat(np.array(lines.before, np.int64), sides)
    corners = np.where(values[:, 0] > 0, values[:, 0] - 1, before + values[:, 0])
    textured = parts > 1 and b"//" not in first
    return corners, values[:, 1] if textured else None, sides


def _labels(path: Path, lines: _Lines, textures: np.ndarray | None, sides: np.ndarray) -> np.ndarray | None:
    """For each face, whether it is observed or missed; None where the file does not say.

    Raises:
        DataError: texture indices are others than C3VD's.
    """
    if textures is None:
        materials = np.array(lines.materials)
        return materials if (materials > 0).all() else None
    labels = textures[np.cumsum(sides) - sides]
    strange = (textures != np.repeat(labels, sides)) | ~np.isin(textures, (OBSERVED, MISSED))
    if strange.any():
        face = int(np.repeat(np.arange(len(sides)), sides)[strange.argmax()])
        raise DataError(
            f"{path}: expected faces f a/1 b/1 c/1 (observed) or f a/2 b/2 c/2 (missed), got "
            f"f {lines.faces[face].decode('ascii', 'replace')} as face {face + 1}"
        )
    expected = list(COORDINATES.values())
    coordinates = [tuple(row) for row in _table(lines.textures, 2, "vt").tolist()]
    if lines.textures and coordinates != expected:
        raise DataError(
            f"{path}: expected two texture coordinates, vt 0 0 (observed) and vt 1 1 (missed), got "
            f"{len(coordinates)} that begin with {coordinates[:2]}"
        )
    return labels


def _fans(corners: np.ndarray, sides: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Triangles of faces of any number of corners, and the face of each."""
    of_face = np.repeat(np.arange(len(sides)), sides - 2)
    starts = np.cumsum(sides) - sides
    within = np.arange(len(of_face)) - np.repeat(np.cumsum(sides - 2) - (sides - 2), sides - 2)
    first = starts[of_face]
    triangles = np.stack([corners[first], corners[first + within + 1], corners[first + within + 2]], axis=1)
    return triangles, of_face
