"""coverage_mesh.obj: as C3VD's renderer writes it, as phantoms wrote it before, and what is neither."""

from pathlib import Path

import numpy as np
import pytest
from refusals import refused

from col3d.data.datasets.coverage_mesh import CoverageMesh, read_coverage_mesh, write_coverage_mesh
from col3d.errors import DataError

CORNERS = ["v 0 0 0", "v 1 0 0", "v 0 1 0", "v 0 0 1"]
COORDINATES = ["vt 0.0 0.0", "vt 1.0 1.0"]


def written(tmp_path: Path, *lines: str) -> Path:
    path = tmp_path / "coverage_mesh.obj"
    path.write_text("\n".join(lines) + "\n")
    return path


def test_the_form_of_the_renderer(tmp_path: Path) -> None:
    faces = ["f 1/1 2/1 3/1", "f 1/2 2/2 4/2", "f 1/1 3/1 4/1"]
    mesh = read_coverage_mesh(written(tmp_path, *CORNERS, *COORDINATES, *faces))
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    assert mesh.triangles.tolist() == [[0, 1, 2], [0, 1, 3], [0, 2, 3]]
    assert mesh.observed is not None
    assert mesh.observed.tolist() == [True, False, True]
    assert mesh.seen.tolist() == [[0, 1, 2], [0, 2, 3]]


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    vertices, triangles = random.uniform(-90, 90, (50, 3)), random.integers(0, 50, (80, 3))
    mesh = CoverageMesh(vertices.round(3), triangles, random.random(80) < 0.5)
    path = tmp_path / "coverage_mesh.obj"
    write_coverage_mesh(path, mesh)
    again = read_coverage_mesh(path)
    assert np.array_equal(again.vertices, mesh.vertices)
    assert np.array_equal(again.triangles, mesh.triangles)
    assert np.array_equal(again.observed, mesh.observed)
    assert path.read_text().splitlines()[50:53] == [*COORDINATES, _face(mesh)]


def _face(mesh: CoverageMesh) -> str:
    assert mesh.observed is not None
    label = 1 if mesh.observed[0] else 2
    return "f " + " ".join(f"{corner + 1}/{label}" for corner in mesh.triangles[0])


def test_phantoms_of_before(tmp_path: Path) -> None:
    """Faces of four corners, by material."""
    lines = ["# mm", *CORNERS, "usemtl 0", "f 1 2 3 4", "usemtl 1", "f -4 -3 -1 -2"]
    mesh = read_coverage_mesh(written(tmp_path, *lines))
    assert mesh.triangles.tolist() == [[0, 1, 2], [0, 2, 3], [0, 1, 3], [0, 3, 2]]
    assert mesh.observed is not None
    assert mesh.observed.tolist() == [True, True, False, False]


@pytest.mark.parametrize(
    "faces",
    [["f 1 2 3"], ["f 1//1 2//1 3//1"], ["g 0", "f 1 2 3", "g 1", "f 1 2 4"], ["usemtl wall", "f 1 2 3"]],
)
def test_a_mesh_that_says_nothing(tmp_path: Path, faces: list[str]) -> None:
    mesh = read_coverage_mesh(written(tmp_path, *CORNERS, *faces))
    assert mesh.observed is None
    assert np.array_equal(mesh.seen, mesh.triangles)


def test_vertices_with_colours_behind_them(tmp_path: Path) -> None:
    coloured = [f"{corner} 0.1 0.2 0.3" for corner in CORNERS]
    mesh = read_coverage_mesh(written(tmp_path, *coloured, *COORDINATES, "f 1/1/1 2/1/1 3/1/1"))
    assert mesh.vertices[1].tolist() == [1, 0, 0]
    assert mesh.observed is not None
    assert mesh.observed.all()


@pytest.mark.parametrize(
    ("lines", "named"),
    [
        ([*COORDINATES, "f 1/1 2/1 3/1", "f 1/3 2/3 3/3"], ("f 1/3 2/3 3/3", "face 2")),
        ([*COORDINATES, "f 1/1 2/1 3/2"], ("f 1/1 2/1 3/2", "face 1")),
        ([*COORDINATES, "f 1/0 2/0 3/0"], ("f 1/0 2/0 3/0", "face 1")),
        ([*COORDINATES, "vt 0.5 0.5", "f 1/1 2/1 3/1"], ("texture", "got 3")),
        (["vt 1 1", "vt 0 0", "f 1/1 2/1 3/1"], ("texture", "[(1.0, 1.0)")),
        ([*COORDINATES, "f 1/2 2/2 3/2"], ("all of its faces",)),
        (["usemtl 1", "f 1 2 3"], ("all of its faces",)),
        (["f 1 2 9"], ("vertices that are not there",)),
        (["f 1 2"], ("three corners",)),
        (["f 1/1 2/1 3"], ("written alike",)),
        (["f a b c"], ("OBJ",)),
        (["v nan 0 0", "f 1 2 3"], ("vertices", "finite")),
        (["v 1 2", "f 1 2 3"], ("lines v of 3 numbers",)),
        ([], ("three corners",)),
    ],
)
def test_what_is_no_coverage_is_one_line(tmp_path: Path, lines: list[str], named: tuple[str, ...]) -> None:
    with refused(DataError, tmp_path / "coverage_mesh.obj", *named) as error:
        read_coverage_mesh(written(tmp_path, *CORNERS, *lines))
    assert "\n" not in str(error.value)


def test_a_mesh_of_a_million_faces(tmp_path: Path) -> None:
    side = 708
    corner = np.arange(side * side).reshape(side, side)
    here, right, below, across = corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]
    halves = [
        np.stack(half, axis=-1).reshape(-1, 3) for half in ((here, right, across), (here, across, below))
    ]
    grid = np.stack([*np.divmod(np.arange(side * side), side), np.zeros(side * side)], axis=1)
    triangles = np.concatenate(halves)[: 1_000_000 - 302]
    mesh = CoverageMesh(grid, triangles, np.arange(len(triangles)) % 3 > 0)
    write_coverage_mesh(tmp_path / "coverage_mesh.obj", mesh)
    again = read_coverage_mesh(tmp_path / "coverage_mesh.obj")
    assert len(again.triangles) > 999_000
    assert np.array_equal(again.triangles, triangles)
    assert np.array_equal(again.observed, mesh.observed)
