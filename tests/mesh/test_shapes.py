"""Procedural shapes against closed forms and against what any mesh of a solid must satisfy."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

import numpy as np
import pytest

from ldsim.errors import MeshError
from ldsim.mesh.mesh import Mesh, check_cells, components, corner_volumes
from ldsim.mesh.shapes import (
    CUBE_CORNERS,
    SHAPES,
    beam,
    catapult,
    cross,
    dumbbell,
    mounted_bar,
    pendulum,
    slender_cross,
    voxel_mesh,
)
from ldsim.mesh.surface import CELL_FACES, surface_triangles, surface_vertices

CELL_TYPES = ["tet4", "hex8"]


def enclosed_volume(mesh: Mesh) -> float:
    """∫ div(x/3) over the solid as the flux through its surface triangles."""
    a, b, c = np.moveaxis(mesh.vertices[surface_triangles(mesh)], 1, 0)
    return float(np.einsum("ti,ti->", a, np.cross(b, c)) / 6)


def surface_area(mesh: Mesh) -> float:
    a, b, c = np.moveaxis(mesh.vertices[surface_triangles(mesh)], 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def face_counts(mesh: Mesh) -> Counter[tuple[int, ...]]:
    faces = mesh.cells[:, CELL_FACES[mesh.cell_type]].reshape(-1, CELL_FACES[mesh.cell_type].shape[1])
    return Counter(map(tuple, np.sort(faces, axis=1).tolist()))


@pytest.fixture(params=[(name, kind) for name in SHAPES for kind in CELL_TYPES], ids=" ".join)
def shape(request: pytest.FixtureRequest) -> Mesh:
    name, kind = request.param
    return SHAPES[name](resolution=2, cell_type=kind)


def test_no_cell_is_inverted_or_degenerate(shape: Mesh) -> None:
    check_cells(shape)


def test_every_vertex_is_used_and_the_solid_is_one_piece(shape: Mesh) -> None:
    assert set(shape.cells.ravel()) == set(range(shape.n_vertices))
    assert set(components(shape)) == {0}


def test_each_face_belongs_to_one_cell_or_is_shared_by_two(shape: Mesh) -> None:
    counts = face_counts(shape)
    assert set(counts.values()) == {1, 2}
    triangles_a_face = 1 if shape.cell_type == "tet4" else 2
    assert list(counts.values()).count(1) * triangles_a_face == len(surface_triangles(shape))


def test_the_surface_is_closed_with_each_edge_once_in_either_direction(shape: Mesh) -> None:
    triangles = surface_triangles(shape)
    edges = Counter(map(tuple, triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).tolist()))
    assert set(edges.values()) == {1}
    assert all((b, a) in edges for a, b in edges)


def test_the_surface_is_a_sphere_by_its_euler_characteristic(shape: Mesh) -> None:
    triangles = surface_triangles(shape)
    edges = np.unique(np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    assert len(surface_vertices(shape)) - len(edges) + len(triangles) == 2


def test_a_ring_of_voxels_has_the_surface_of_a_torus() -> None:
    ring = np.ones((3, 3, 1), dtype=bool)
    ring[1, 1, 0] = False
    mesh = voxel_mesh(ring, 1.0)
    triangles = surface_triangles(mesh)
    assert len(surface_vertices(mesh)) - 3 * len(triangles) // 2 + len(triangles) == 0


@pytest.mark.parametrize("name", SHAPES)
def test_tets_fill_what_their_outward_surface_encloses(name: str) -> None:
    mesh = SHAPES[name](resolution=2)
    assert corner_volumes(mesh).sum() == pytest.approx(enclosed_volume(mesh), rel=1e-12)


@pytest.mark.parametrize("cell_type", CELL_TYPES)
def test_every_face_of_a_single_cell_looks_outward(cell_type: str) -> None:
    points = CUBE_CORNERS[[0, 1, 3, 4]] if cell_type == "tet4" else CUBE_CORNERS
    cell = Mesh(points, np.arange(len(points), dtype=np.int32)[None], cell_type)
    a, b, c = np.moveaxis(cell.vertices[surface_triangles(cell)], 1, 0)
    outward = np.einsum("ti,ti->t", np.cross(b - a, c - a), (a + b + c) / 3 - cell.vertices.mean(axis=0))
    assert len(outward) == (4 if cell_type == "tet4" else 12)
    assert (outward > 0).all()


@pytest.mark.parametrize("cell_type", CELL_TYPES)
def test_a_beam_has_the_size_volume_and_area_asked_for(cell_type: str) -> None:
    mesh = beam(0.7, 0.2, 0.13, resolution=2, cell_type=cell_type)
    np.testing.assert_allclose(mesh.vertices.min(axis=0), [0, -0.065, -0.1], atol=1e-15)
    np.testing.assert_allclose(mesh.vertices.max(axis=0), [0.7, 0.065, 0.1], atol=1e-15)
    assert enclosed_volume(mesh) == pytest.approx(0.7 * 0.2 * 0.13, rel=1e-12)
    assert surface_area(mesh) == pytest.approx(2 * (0.7 * 0.2 + 0.7 * 0.13 + 0.2 * 0.13), rel=1e-12)


@pytest.mark.parametrize("make, bobs", [(pendulum, 1), (dumbbell, 2)])
def test_a_weighted_rod_is_a_rod_and_cubes(make: Callable[..., Mesh], bobs: int) -> None:
    mesh = make(resolution=2)
    rod, bob = 0.3 - 0.06 * bobs, 0.06
    assert enclosed_volume(mesh) == pytest.approx(rod * 0.02**2 + bobs * bob**3, rel=1e-12)
    sides_and_caps = 4 * rod * 0.02 + 6 * bobs * bob**2
    assert surface_area(mesh) == pytest.approx(sides_and_caps + (2 - 2 * bobs) * 0.02**2, rel=1e-12)


@pytest.mark.parametrize("make, arms, size", [(cross, 2, 0.22 * 0.15 * 0.05), (slender_cross, 6, 0.3 * 0.26 * 0.025)])
@pytest.mark.parametrize("cell_type", CELL_TYPES)
@pytest.mark.parametrize("resolution", [1, 2, 3])
def test_a_cross_has_the_volume_of_its_map(
    make: Callable[..., Mesh], arms: int, size: float, resolution: int, cell_type: str
) -> None:
    # ∫ over the plus of the Jacobian ab (2 − s − q s'), with a = width/(2e + 2), b = height/2e, e = 2 arms + 1: 2·4 in
    # the middle square and 3/2 · 4 arms on each arm. The map's kinks lie on grid lines and s is odd about an arm's
    # middle, so it is exact.
    mesh = make(resolution, cell_type)
    end = 2 * arms + 1
    expected = (8 + 4 * 6 * arms) * size / (2 * end + 2) / (2 * end)
    assert enclosed_volume(mesh) == pytest.approx(expected, rel=1e-12)


def test_limbs_of_the_slender_cross_are_twice_as_long_for_their_thickness() -> None:
    def slenderness(mesh: Mesh) -> float:
        # Four limbs of length l and thickness t, almost: volume 4 l t · depth, and l from the middle to a corner.
        width, height, depth = np.ptp(mesh.vertices, axis=0)
        length = np.hypot(width, height) / 2
        return float(length / (enclosed_volume(mesh) / (4 * length * depth)))

    assert slenderness(slender_cross()) > 2 * slenderness(cross())


@pytest.mark.parametrize("resolution", [1, 3])
def test_a_mounted_bar_is_a_plate_and_a_bar(resolution: int) -> None:
    mesh = mounted_bar(resolution)
    assert enclosed_volume(mesh) == pytest.approx(0.4 * 0.04**2 + 0.12**2 * 0.04, rel=1e-12)
    plate, bar = mesh.vertices[mesh.vertices[:, 0] < 1e-12], mesh.vertices[mesh.vertices[:, 0] > 1e-12]
    np.testing.assert_allclose(np.ptp(plate, axis=0), [0.04, 0.12, 0.12], rtol=1e-12)
    np.testing.assert_allclose(np.ptp(bar[:, 1:], axis=0), [0.04, 0.04], rtol=1e-12)
    np.testing.assert_allclose([bar[:, 0].max(), *bar[:, 1:].mean(axis=0)], [0.4, 0, 0], atol=1e-12)


@pytest.mark.parametrize("resolution", [1, 3])
def test_a_catapult_stands_on_its_foot_and_its_bowl_holds_something(resolution: int) -> None:
    mesh = catapult(resolution)
    foot, arm, floor, rim = 25, 15 - 1 - 5, 25, 25 - 9
    assert enclosed_volume(mesh) == pytest.approx((foot + arm + floor + rim) * 0.02**3, rel=1e-12)
    assert mesh.vertices[:, 1].min() == 0
    assert mesh.vertices[:, 1].max() == pytest.approx(0.3, rel=1e-12)
    bowl = mesh.vertices[mesh.vertices[:, 1] > 0.2]
    assert bowl[:, 0].max() == pytest.approx(0.03) and bowl[:, 0].min() == pytest.approx(-0.01)


def test_a_cross_fills_its_box_and_stands_on_two_flat_feet() -> None:
    mesh = cross(resolution=2)
    np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), [0.22, 0.15, 0.05], rtol=1e-12)
    feet = mesh.vertices[mesh.vertices[:, 1] < -0.075 + 1e-12]
    assert len(feet) == 2 * 3 * 3
    assert {tuple(foot) for foot in np.sign(feet[:, :1]).tolist()} == {(-1.0,), (1.0,)}


@pytest.mark.parametrize("name", SHAPES)
def test_cells_grow_with_the_cube_of_the_resolution(name: str) -> None:
    assert SHAPES[name](resolution=2).n_cells == 8 * SHAPES[name](resolution=1).n_cells


@pytest.mark.parametrize("name", SHAPES)
def test_a_voxel_makes_one_hex_or_six_tets(name: str) -> None:
    assert SHAPES[name](resolution=1).n_cells == 6 * SHAPES[name](resolution=1, cell_type="hex8").n_cells


BAD_CALLS = {
    "length": (lambda: beam(length=0), "a beam of 0 × 0.1 × 0.1 m; each side must be positive"),
    "nan": (lambda: beam(width=float("nan")), "× nan m"),
    "resolution 0": (lambda: beam(resolution=0), "resolution is 0; .* from 1 to"),
    "fraction": (lambda: beam(resolution=1.5), "resolution is 1.5"),  # type: ignore[arg-type]
    "cell type": (lambda: beam(cell_type="wedge6"), "cell type 'wedge6' is not one of tet4, hex8"),
    "too many": (lambda: beam(length=1e6), "needs .* voxels; allowed are"),
    "too fine a bar": (lambda: mounted_bar(resolution=65), "resolution is 65"),
    "too fine a cross": (lambda: slender_cross(resolution=64), "needs .* voxels; allowed are"),
    "too fine a rod": (lambda: pendulum(resolution=64), "needs .* voxels; allowed are"),
    "spacing": (lambda: voxel_mesh(np.ones((1, 1, 1), dtype=bool), [1, -1, 1]), "voxel spacing is"),
    "nothing": (lambda: voxel_mesh(np.zeros((2, 1, 1), dtype=bool), 1), "have 0 occupied"),
}


@pytest.mark.parametrize("make, message", BAD_CALLS.values(), ids=BAD_CALLS.keys())
def test_bad_parameters_are_refused_in_one_line(make: Callable[[], Mesh], message: str) -> None:
    with pytest.raises(MeshError, match=message) as refusal:
        make()
    assert "\n" not in str(refusal.value)
