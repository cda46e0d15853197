"""Mesh files: one round trip for every format, one table of bad input."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Callable
from pathlib import Path

import meshio
import numpy as np
import pytest

from ldsim.errors import MeshError
from ldsim.mesh.formats import CELL_TYPES, read_mesh, read_surface
from ldsim.mesh.mesh import Mesh
from ldsim.mesh.repair import repaired
from ldsim.mesh.shapes import CUBE_CORNERS, beam, cross
from tests.mesh.surfaces import is_closed_and_oriented, surface_of

# All that meshio can write both for tets and for hexes, and reads back; .xml and .ele hold tets only.
EXTENSIONS = [
    *(".mesh", ".meshb", ".vtk", ".vtu", ".msh", ".inp", ".xdmf", ".xmf", ".avs", ".dat", ".tec", ".dato", ".post"),
    *(".f3grid", ".hmf", ".mdpa", ".med", ".su2", ".vol"),
]
TET_EXTENSIONS = [".xml", ".ele", ".cgns"]
SURFACE_EXTENSIONS = [".stl", ".obj", ".ply", ".off", ".vtk", ".msh"]
TET = np.array([[0, 1, 2, 3]])
POINTS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1], [2, 1, 1], [1, 2, 1], [1, 1, 2]])


def write(path: Path, mesh: Mesh) -> None:
    """Write a mesh in the format that the extension names; what meshio prints goes nowhere."""
    name = next(theirs for theirs, ours in CELL_TYPES.items() if ours == mesh.cell_type)
    with contextlib.redirect_stdout(None), contextlib.redirect_stderr(None), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        meshio.Mesh(mesh.vertices, [(name, mesh.cells)]).write(path)


def medit(points: np.ndarray, cells: list[tuple[str, np.ndarray]]) -> Callable[[Path], Path]:
    """A maker of a file bad.mesh in a directory."""

    def make(folder: Path) -> Path:
        meshio.Mesh(points, cells).write(folder / "bad.mesh")
        return folder / "bad.mesh"

    return make


def text(name: str, content: str) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        (folder / name).write_text(content)
        return folder / name

    return make


def truncated(extension: str, share: float) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        path = folder / f"cut{extension}"
        write(path, beam(resolution=1))
        whole = path.read_bytes()
        path.write_bytes(whole[: int(share * len(whole))])
        return path

    return make


def directory(folder: Path) -> Path:
    (folder / "d.mesh").mkdir()
    return folder / "d.mesh"


BAD_FILES = {
    "missing": (lambda folder: folder / "none.mesh", "does not exist"),
    "directory": (directory, "is a directory"),
    "empty": (text("empty.mesh", ""), "is empty"),
    "unknown extension": (text("mesh.docx", "x"), r"unknown extension '\.docx'; allowed are \.mesh"),
    "no extension": (text("mesh", "x"), "unknown extension ''"),
    "foreign .mesh": (text("foreign.mesh", "not a mesh at all\n"), "is not a readable .mesh file"),
    "foreign .vtk": (text("foreign.vtk", "not a mesh at all\n"), "is not a readable .vtk file"),
    "foreign .vtu": (text("foreign.vtu", "<not><xml>"), "is not a readable .vtu file"),
    "foreign .msh": (text("foreign.msh", "not a mesh at all\n"), "foreign.msh"),
    "truncated .mesh": (truncated(".mesh", 0.3), "cut.mesh"),
    "truncated .vtk": (truncated(".vtk", 0.5), "cut.vtk"),
    "truncated .vtu": (truncated(".vtu", 0.5), "cut.vtu"),
    "truncated .msh": (truncated(".msh", 0.5), "cut.msh"),
    "truncated .inp": (truncated(".inp", 0.2), "cut.inp"),
    "surface only": (medit(POINTS, [("triangle", TET[:, :3])]), "no tetrahedra or hexahedra but 1 triangle"),
    "two volume types": (medit(POINTS, [("tetra", TET), ("hexahedron", np.arange(8)[None])]), "mixes volume cells"),
    "wedges": (medit(POINTS, [("wedge", np.arange(6)[None])]), "holds 1 wedge; allowed .* tetra, hexahedron"),
    "not a number": (medit(np.where(POINTS == 2, np.nan, POINTS), [("tetra", TET)]), "vertex 5 has coordinates"),
    "index too large": (medit(POINTS, [("tetra", TET + 6)]), "cell 0 refers to vertices"),
}


@pytest.mark.parametrize("scale", [0.0, -1.0, float("nan"), float("inf")])
def test_a_scale_that_is_no_positive_number_is_refused(scale: float, tmp_path: Path) -> None:
    with pytest.raises(MeshError, match="scale is"):
        read_mesh(tmp_path / "any.mesh", scale)


@pytest.mark.parametrize(
    ("extension", "cell_type"),
    [
        *((extension, kind) for extension in EXTENSIONS for kind in ("tet4", "hex8")),
        *((e, "tet4") for e in TET_EXTENSIONS),
    ],
)
def test_every_format_returns_the_mesh_that_was_written(extension: str, cell_type: str, tmp_path: Path) -> None:
    mesh = cross(resolution=1, cell_type=cell_type)
    write(tmp_path / f"mesh{extension}", mesh)
    back = read_mesh(tmp_path / f"mesh{extension}")
    assert back.mesh.cell_type == cell_type
    np.testing.assert_array_equal(back.mesh.cells, mesh.cells)
    np.testing.assert_allclose(back.mesh.vertices, mesh.vertices, rtol=0, atol=1e-15)
    assert back.dropped_vertices == 0


def test_the_scale_multiplies_the_coordinates(tmp_path: Path) -> None:
    mesh = beam(resolution=1)
    write(tmp_path / "mesh.vtu", mesh)
    np.testing.assert_allclose(read_mesh(tmp_path / "mesh.vtu", 1e-3).mesh.vertices, mesh.vertices * 1e-3, rtol=1e-15)


def test_unused_vertices_are_dropped_and_counted(tmp_path: Path) -> None:
    back = read_mesh(medit(POINTS, [("tetra", TET + 4)])(tmp_path))
    assert back.dropped_vertices == 4
    np.testing.assert_array_equal(back.mesh.vertices, POINTS[4:])
    np.testing.assert_array_equal(back.mesh.cells, TET)


def test_several_blocks_of_one_type_are_joined_and_surface_cells_ignored(tmp_path: Path) -> None:
    cells = [("tetra", TET), ("triangle", TET[:, :3]), ("tetra", TET + 4)]
    meshio.Mesh(POINTS, cells).write(tmp_path / "blocks.vtu")
    np.testing.assert_array_equal(read_mesh(tmp_path / "blocks.vtu").mesh.cells, [[0, 1, 2, 3], [4, 5, 6, 7]])


# Two tets on a common face; a face of the first and the edges of another serve as parts of lower dimension.
PAIR = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1], [9, 9, 9]])
BLOCKS = [("tetra", np.array([[0, 1, 2, 3], [1, 2, 3, 4]])), ("triangle", np.array([[0, 1, 2], [0, 1, 3]]))]


def gmsh(names: dict[str, tuple[int, int]]) -> Callable[[Path], Path]:
    """Named groups, by number and dimension, beside a face without one, as in Gmsh's format 2.2."""

    def write(folder: Path) -> Path:
        tags = [np.array([7, 8]), np.array([3, 0])]
        data = {"gmsh:physical": tags, "gmsh:geometrical": tags}
        fields = {name: np.array(number) for name, number in names.items()}
        mesh = meshio.Mesh(PAIR, BLOCKS, cell_data=data, field_data=fields)
        mesh.write(folder / "a.msh", file_format="gmsh22", binary=False)
        return folder / "a.msh"

    return write


def medit_with_numbers(folder: Path) -> Path:
    data = {"medit:ref": [np.array([0, 5]), np.array([2, 2])]}
    points = {"medit:ref": np.array([0, 0, 4, 4, 0, 4])}
    meshio.Mesh(PAIR, BLOCKS, cell_data=data, point_data=points).write(folder / "a.mesh")
    return folder / "a.mesh"


def abaqus(folder: Path) -> Path:
    sets = {"right": [np.array([1]), np.array([], dtype=int)]}
    mesh = meshio.Mesh(PAIR, BLOCKS, point_sets={"held": np.array([3, 1])}, cell_sets=sets)
    mesh.write(folder / "a.inp")
    return folder / "a.inp"


Parts = dict[str, tuple[list[int], list[int]]]
GROUPED: dict[str, tuple[Callable[[Path], Path], Parts]] = {
    "gmsh": (
        gmsh({"inner": (7, 3), "foot": (3, 2)}),  # and a number without a name
        {"inner": ([0, 1, 2, 3], [0]), "cells_8": ([1, 2, 3, 4], [1]), "foot": ([0, 1, 2], [])},
    ),
    "slashes": (
        gmsh({"a/b": (7, 3), "a_b": (8, 3), ".": (3, 2)}),  # no names of HDF5, and two that become the same
        {"a_b": ([0, 1, 2, 3, 4], [0, 1]), "unnamed": ([0, 1, 2], [])},
    ),
    "medit": (
        medit_with_numbers,
        {"cells_5": ([1, 2, 3, 4], [1]), "faces_2": ([0, 1, 2, 3], []), "points_4": ([2, 3], [])},
    ),
    "abaqus": (abaqus, {"right": ([1, 2, 3, 4], [1]), "held": ([1, 3], [])}),
}


@pytest.mark.parametrize(("make", "expected"), GROUPED.values(), ids=GROUPED)
def test_parts_of_a_file_become_groups_of_the_vertices_and_cells_that_are_used(
    make: Callable[[Path], Path], expected: Parts, tmp_path: Path
) -> None:
    read = read_mesh(make(tmp_path))
    assert read.dropped_vertices == 1
    found = {name: (group.vertices.tolist(), group.cells.tolist()) for name, group in read.mesh.groups.items()}
    assert found == expected


@pytest.mark.parametrize(
    "tags", [np.array([np.nan, 1.0]), np.array([1.0, np.inf]), np.eye(3)[:2]], ids=["nan", "infinite", "vectors"]
)
def test_data_that_are_only_called_like_the_numbers_of_parts_make_no_groups(tags: np.ndarray, tmp_path: Path) -> None:
    of_points = np.resize(tags, (len(PAIR), *tags.shape[1:]))
    mesh = meshio.Mesh(PAIR, BLOCKS[:1], cell_data={"medit:ref": [tags]}, point_data={"medit:ref": of_points})
    mesh.write(tmp_path / "a.vtu")
    read = read_mesh(tmp_path / "a.vtu").mesh
    assert read.n_cells == 2 and not read.groups


def test_groups_follow_their_vertices_when_unused_ones_are_dropped(tmp_path: Path) -> None:
    points = np.vstack([[[9.0, 9, 9]], PAIR[:5]])
    blocks = [("tetra", BLOCKS[0][1] + 1)]
    data = {"gmsh:physical": [np.array([1, 2])], "gmsh:geometrical": [np.array([1, 2])]}
    meshio.Mesh(points, blocks, cell_data=data).write(tmp_path / "a.msh", file_format="gmsh22", binary=False)
    mesh = read_mesh(tmp_path / "a.msh").mesh
    assert mesh.groups["cells_2"].vertices.tolist() == [1, 2, 3, 4]


def test_numbers_of_cells_are_read_in_the_order_of_the_cells(tmp_path: Path) -> None:
    blocks = [("tetra", BLOCKS[0][1][:1]), BLOCKS[1], ("tetra", BLOCKS[0][1][1:])]
    data = {"E": [np.array([1.0]), np.array([8.0, 9.0]), np.array([2.0])]}
    meshio.Mesh(PAIR, blocks, cell_data=data).write(tmp_path / "a.vtu")
    read = read_mesh(tmp_path / "a.vtu")
    assert read.cell_data["E"].tolist() == [1, 2]
    np.testing.assert_array_equal(read.mesh.cells, BLOCKS[0][1])


@pytest.mark.parametrize("extension", SURFACE_EXTENSIONS)
def test_a_surface_file_returns_its_triangles_scaled(extension: str, tmp_path: Path) -> None:
    surface = surface_of("catapult")
    path = tmp_path / f"surface{extension}"
    meshio.Mesh(surface.vertices, [("triangle", surface.faces)]).write(path)
    back = read_surface(path, 1e-3)
    assert back.volume == pytest.approx(surface.volume * 1e-9, rel=1e-6)
    assert is_closed_and_oriented(repaired(back).surface)
    assert len(back.faces) == len(surface.faces)


def test_quadrilaterals_of_a_surface_are_cut_in_two(tmp_path: Path) -> None:
    faces = "1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8"
    corners = "\n".join(f"v {x:g} {y:g} {z:g}" for x, y, z in CUBE_CORNERS)
    (tmp_path / "cube.obj").write_text(f"{corners}\nf {faces}\n")
    cube = read_surface(tmp_path / "cube.obj")
    assert len(cube.faces) == 12
    assert cube.volume == pytest.approx(1)
    assert is_closed_and_oriented(cube)


BAD_SURFACES = {
    "missing": (lambda folder: folder / "none.stl", "does not exist"),
    "foreign": (text("a.stl", "not a surface at all\n"), "a.stl"),
    "truncated": (text("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n"), "is not a readable .off file"),
    "a volume": (medit(POINTS, [("tetra", TET)]), "holds cells of the type tetra; .* read with mesh.file"),
    "no triangles": (text("a.off", "OFF\n1 0 0\n0 0 0\n"), "a.off"),
    "painted, too far": (text("a.obj", "v 0 0 0\nv 1e200 0 0\nv 0 1 0\nf 1 2 3\n"), "vertex . has coordinates"),
    "not a number": (text("a.off", "OFF\n3 1 0\n0 0 nan\n1 0 0\n0 1 0\n3 0 1 2\n"), "vertex 0 has coordinates"),
}


BAD = {f"mesh, {name}": (read_mesh, *bad) for name, bad in BAD_FILES.items()} | {
    f"surface, {name}": (read_surface, *bad) for name, bad in BAD_SURFACES.items()
}


@pytest.mark.parametrize("read, make, message", BAD.values(), ids=BAD.keys())
def test_a_bad_file_is_refused_in_one_line_that_names_it(
    read: Callable[[Path], object],
    make: Callable[[Path], Path],
    message: str,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
) -> None:
    path = make(tmp_path)
    with pytest.raises(MeshError, match=message) as refusal:
        read(path)
    assert str(path) in str(refusal.value)
    assert "\n" not in str(refusal.value)
    assert capfd.readouterr() == ("", "")
