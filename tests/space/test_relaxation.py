"""Relaxed poses: derivatives by differences, static condensation by hand, and the ends of the range of r."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag, eigh
from scipy.spatial.transform import Rotation

from ldsim.arrays import Array, Indices
from ldsim.dynamics.full.options import FullOptions
from ldsim.dynamics.full.stepper import FullStepper
from ldsim.dynamics.reduced.in_series import InSeries
from ldsim.dynamics.reduced.potential import Springs
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.dynamics.reduced.warped import warp_springs
from ldsim.errors import SolverError
from ldsim.mechanics.elastic import add_elastic_gradient
from ldsim.mechanics.grabs import Grab
from ldsim.mechanics.loads import Loads
from ldsim.mechanics.materials import MATERIALS
from ldsim.mechanics.scene import Scene
from ldsim.mechanics.stiffness import StiffnessPattern
from ldsim.mesh.shapes import beam as beam_mesh
from ldsim.space.basis import Basis
from ldsim.space.compliance import MOST_CHANGED, Compliance, warp
from ldsim.space.relaxation import Relaxation, Relaxed
from tests.helpers import derivative_order, order, reduced_space, scene, uniform_scene


def beam(**given: float) -> Scene:
    return scene(beam_mesh(0.3, 0.1, 0.1, 1), gravity=(0.0, 0.0, 0.0), **given)


def rest_matrices(body: Scene) -> tuple[Array, Array, Array]:
    """K₀ and M over the free degrees of freedom, dense, and the numbers of these."""
    pattern = StiffnessPattern(body.points.nodes, body.free, body.mesh.n_vertices)
    zero = np.zeros((body.mesh.n_vertices, 3))
    K = pattern.matrix(pattern.stiffness_blocks(body.elements, zero, clamp=False)).toarray()
    M = np.kron(body.mass.toarray()[np.ix_(body.free, body.free)], np.eye(3))
    return K, M, (3 * body.free[:, None] + np.arange(3)).ravel()


def modes(body: Scene, r: int) -> Basis:
    """The lowest vibration modes, orthonormal in the mass."""
    K, M, unknown = rest_matrices(body)
    V = np.zeros((3 * body.mesh.n_vertices, r))
    V[unknown] = eigh(K, M)[1][:, :r]
    return Basis.of(V, body.mass)


@pytest.fixture(scope="module")
def relaxation() -> Relaxation:
    body = beam()
    return Relaxation(body, modes(body, 3))


def bent_z(relaxation: Relaxation) -> Array:
    """A pose far from rest, as long a way as the beam's own height."""
    reach = 0.05 / np.abs(relaxation.coordinates.fields).max(axis=(0, 1))
    return reach * np.array([1.0, -0.7, 0.5])


@pytest.mark.parametrize(
    ("value", "slope"),
    [
        (lambda pose: pose.energy, lambda pose, d: pose.force @ d),
        (lambda pose: pose.force, lambda pose, d: pose.stiffness @ d),
        (lambda pose: pose.u, lambda pose, d: pose.tangents @ d),
    ],
    ids=["force of energy", "stiffness of force", "tangents of pose"],
)
def test_derivatives_of_a_relaxed_pose_are_those_of_differences(
    relaxation: Relaxation, value: Callable[[Relaxed], Array], slope: Callable[[Relaxed, Array], Array]
) -> None:
    z = bent_z(relaxation)
    d = np.array([0.3, 0.5, -0.8]) * np.linalg.norm(z)
    found = derivative_order(lambda x: value(relaxation(x)), lambda x: slope(relaxation(x), d), z, d)
    assert 1.9 < found < 2.2


def test_a_relaxed_pose_has_its_coordinates_and_no_force_but_on_them(relaxation: Relaxation) -> None:
    z = bent_z(relaxation)
    pose = relaxation(z)
    np.testing.assert_allclose(relaxation.encode(pose.u[None])[0], z, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(relaxation.encode(np.moveaxis(pose.tangents, 2, 0)), np.eye(3), atol=1e-9)
    np.testing.assert_array_equal(pose.u[relaxation.scene.pinned], 0)


def test_from_a_pose_of_the_solid_and_from_rest_the_same_equilibrium_is_found(relaxation: Relaxation) -> None:
    pose = relaxation(bent_z(relaxation))
    shaken = pose.u + 2e-3 * np.random.default_rng(0).normal(size=pose.u.shape)
    again = relaxation.from_pose(shaken)
    np.testing.assert_allclose(again.u, relaxation(again.z).u, atol=1e-7)


@pytest.mark.parametrize("longest", [0.06, 0.24, 0.36])
def test_a_slender_solid_blown_up_by_linear_modes_comes_to_an_equilibrium(longest: float) -> None:
    body = scene(beam_mesh(0.6, 0.05, 0.05, 2), gravity=(0.0, 0.0, 0.0))
    blown = modes(body, 12)
    relaxation = Relaxation(body, blown.columns(3))
    u = blown.fields @ (np.random.default_rng(1).normal(size=12) / np.abs(blown.fields).max(axis=(0, 1)))
    u *= longest / np.linalg.norm(u, axis=1).max()  # the longest inverts cells, which costs infinite energy
    pose, force = relaxation.from_pose(u), np.zeros_like(u)
    add_elastic_gradient(body.elements, pose.u, force)
    force[body.pinned] = 0.0
    unheld = relaxation.without_multiplier(force.ravel())
    assert np.linalg.norm(unheld) < 1e-4 * np.linalg.norm(force)
    np.testing.assert_allclose(pose.z, relaxation.encode(u[None])[0], rtol=1e-9, atol=1e-12)


def test_at_rest_it_is_static_condensation(relaxation: Relaxation) -> None:
    K, M, unknown = rest_matrices(relaxation.scene)
    W = relaxation.coordinates.matrix[unknown].T @ M
    condensed = np.linalg.inv(W @ np.linalg.solve(K, W.T))
    np.testing.assert_allclose(relaxation.rest.stiffness, condensed, rtol=1e-8, atol=1e-8)
    tangents = relaxation.rest.tangents.reshape(-1, 3)[unknown]
    np.testing.assert_allclose(tangents, np.linalg.solve(K, W.T) @ condensed, atol=1e-8 * np.abs(tangents).max())


def test_with_as_many_coordinates_as_unknowns_nothing_is_left_to_relax() -> None:
    body = scene(beam_mesh(0.1, 0.1, 0.1, 1), gravity=(0.0, 0.0, 0.0))
    every = Relaxation(body, modes(body, 3 * len(body.free)))
    u = np.zeros((body.mesh.n_vertices, 3))
    u[body.free] = 0.01 * np.random.default_rng(1).normal(size=(len(body.free), 3))
    np.testing.assert_allclose(every(every.encode(u[None])[0]).u, u, atol=1e-10)


def test_where_the_constraint_alone_holds_the_solid_the_derivatives_are_still_right() -> None:
    """A beam pressed along its axis wants to buckle sideways; its second coordinate, the bending, keeps it straight."""
    body = beam(poisson_ratio=0.3)
    V = modes(body, 6)
    relaxation = Relaxation(body, V)
    along = np.zeros((body.mesh.n_vertices, 3))
    along[:, 0] = -0.25 * body.mesh.vertices[:, 0]
    pose = relaxation(relaxation.encode(along[None])[0])
    with pytest.raises(SolverError):
        relaxation.factor(pose.u, clamp=False)
    assert np.linalg.eigvalsh(pose.stiffness)[0] < 0
    d = 1e-6 * np.random.default_rng(2).normal(size=6)
    difference = (relaxation(pose.z + d, pose).force - relaxation(pose.z - d, pose).force) / 2
    np.testing.assert_allclose(difference, pose.stiffness @ d, rtol=1e-4, atol=1e-6 * np.abs(pose.stiffness @ d).max())


def test_what_a_force_moves_beside_the_coordinates_leaves_them_alone(relaxation: Relaxation) -> None:
    compliance = Compliance(relaxation.scene, relaxation.coordinates)
    force = np.random.default_rng(3).normal(size=relaxation.rest.u.shape)
    moved = compliance.of(force)
    np.testing.assert_allclose(relaxation.encode(moved[None]), 0, atol=1e-12 * np.abs(moved).max())
    K, M, unknown = rest_matrices(relaxation.scene)
    W = relaxation.coordinates.matrix[unknown].T @ M
    flexible = np.linalg.inv(K)
    by_hand = flexible - flexible @ W.T @ np.linalg.inv(W @ flexible @ W.T) @ W @ flexible
    np.testing.assert_allclose(moved.reshape(-1)[unknown], by_hand @ force.reshape(-1)[unknown], atol=1e-12)


def test_the_compliance_where_a_solid_has_turned_is_that_of_the_solid_made_turned(relaxation: Relaxation) -> None:
    body, V = relaxation.scene, relaxation.coordinates
    x, R = body.mesh.vertices, Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
    # so weak that it is linear
    vertices, force = np.flatnonzero(x[:, 0] > 0.29)[:3], 1e-10 * np.array([1.0, -2.0, 0.5])
    found = Compliance(body, V).moved(vertices, x @ R.T - x, force)
    turned = uniform_scene(
        replace(body.mesh, vertices=x @ R.T), body.pinned, youngs_modulus=1e5, poisson_ratio=0.4, gravity=(0, 0, 0)
    )
    columns = (V.fields.transpose(0, 2, 1) @ R.T).transpose(0, 2, 1).reshape(V.matrix.shape)
    expected = Compliance(turned, Basis.of(columns, turned.mass)).of_grab(vertices) @ force
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


def test_springs_in_series_pull_as_the_compliance_of_the_turned_solid_lets_them(relaxation: Relaxation) -> None:
    body, V = relaxation.scene, relaxation.coordinates
    space = replace(reduced_space(body, V.matrix), compliance=Compliance(body, V))
    x, q = body.mesh.vertices, 0.05 * np.random.default_rng(6).normal(size=V.k)
    held = [np.flatnonzero(x[:, 0] > 0.29)[:3], np.flatnonzero(np.isclose(x[:, 0], 0.2))[:2]]
    grabs = [Grab(each, x[each].mean(axis=0) + [0.0, 0.1, 0.0], 80.0) for each in held]
    series, targets = InSeries.of(space, grabs, None), np.concatenate([grab.target for grab in grabs])
    series.target[:] = targets
    springs = Springs(np.zeros((2, 3, V.k)), np.zeros((2, 3)), np.zeros((2, 3)), np.ones(2))
    model, _, work = ReducedStepper(space).compiled()
    warp_springs(series, model, q, springs, work)
    u = V.fields @ q
    by_hand = [warp((x + u).T @ space.compliance.arms(each)) for each in held]
    np.testing.assert_allclose(series.warps, by_hand, atol=1e-9)
    assert np.linalg.norm(series.warps[0] - np.eye(3)) > 0.1
    turn = block_diag(*by_hand)
    flexible = np.eye(6) / 80.0 + turn @ (space.compliance.between(held) + block_diag(*series.changes)) @ turn.T
    stretch = targets - np.concatenate([(x + u)[each].mean(axis=0) for each in held]) + series.aside
    assert np.abs(series.changes).max() > 0.01 * np.abs(space.compliance.between(held)).max() and series.aside.any()
    forces = series.pull @ (springs.target - springs.centre - springs.B @ q).ravel()
    np.testing.assert_allclose(flexible @ forces, stretch, rtol=1e-9)


def test_the_compliance_of_a_stiffer_solid_is_that_of_the_solid_made_stiffer(relaxation: Relaxation) -> None:
    force = np.random.default_rng(4).normal(size=relaxation.rest.u.shape)
    scaled = Compliance(relaxation.scene, relaxation.coordinates).stiffened(2.5)
    made = Compliance(relaxation.scene.stiffened(2.5), relaxation.coordinates)
    np.testing.assert_allclose(scaled.of(force), made.of(force), rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(scaled.sag(), made.sag(), rtol=1e-9, atol=1e-15)
    held, pull = np.flatnonzero(relaxation.scene.mesh.vertices[:, 0] > 0.29)[:3], np.array([0.5, 1.0, -0.3])
    u = relaxation.rest.tangents @ np.full(relaxation.r, 0.01)
    np.testing.assert_allclose(scaled.moved(held, u, pull), made.moved(held, u, pull), rtol=1e-6, atol=1e-12)


def test_what_is_kept_of_one_grab_serves_no_other(relaxation: Relaxation) -> None:
    """Asked of one grab and then of another, in turn, and of the solid made stiffer."""

    def fresh() -> Compliance:
        return Compliance(relaxation.scene, relaxation.coordinates)

    ends = np.flatnonzero(relaxation.scene.mesh.vertices[:, 0] > 0.29)
    compliance, grabs = fresh(), (ends[:2], ends[2:4])
    for held in (*grabs, *grabs):
        compliance.dent(held)
    for held in grabs:
        np.testing.assert_array_equal(compliance.fields(held), fresh().fields(held))
    compliance.fields(grabs[0])
    found, alone = (each.stiffened(4.0).dent(grabs[1]) for each in (compliance, fresh()))
    np.testing.assert_array_equal(found.second, alone.second)
    assert np.abs(fresh().dent(grabs[0]).second - fresh().dent(grabs[1]).second).max() > 0


@pytest.fixture
def made(relaxation: Relaxation, monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """Whether K was clamped, for each factor of it that is made."""
    made, factor = list[bool](), relaxation.factor
    monkeypatch.setattr(relaxation, "factor", lambda u, clamp: made.append(clamp) or factor(u, clamp))
    return made


def test_near_its_equilibrium_a_pose_takes_no_factor_but_of_its_start_and_its_end(
    relaxation: Relaxation, made: list[bool]
) -> None:
    near = relaxation(0.05 * bent_z(relaxation))
    made.clear()
    found = relaxation.from_pose(near.u + 0.05 * np.where(relaxation.scene.pinned[:, None], 0.0, near.u[:, ::-1]))
    assert found.solution.iterations > 1  # K could have been made anew
    assert made == [True, False]


def test_where_the_solid_has_turned_its_factor_is_turned_instead_of_made_anew(
    relaxation: Relaxation, made: list[bool]
) -> None:
    assert np.abs(relaxation(2 * bent_z(relaxation)).u).max() > 0.5 * 0.3  # half of the beam's length
    assert made == [False]


def test_a_factor_turned_along_with_a_solid_is_that_of_the_turned_solid(relaxation: Relaxation) -> None:
    body, inverse = relaxation.scene, relaxation.rest.inverse
    assert inverse is not None
    x, (_, M, unknown) = body.mesh.vertices, rest_matrices(body)
    u = x @ Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix().T - x  # pins too: K is turned exactly then
    K, W = relaxation.stiffness(u).toarray()[np.ix_(unknown, unknown)], relaxation.coordinates.matrix[unknown].T @ M
    flexible = np.linalg.inv(K)
    S = np.linalg.inv(W @ flexible @ W.T)
    turned = inverse.turned(u)
    np.testing.assert_allclose(turned.stiffness, S, atol=1e-9 * np.abs(S).max())
    np.testing.assert_allclose(turned.tangents[:, unknown], S @ W @ flexible, atol=1e-9)
    force = np.zeros((1, x.size))
    force[0, unknown] = np.random.default_rng(0).normal(size=len(unknown))
    expected = flexible @ force[0, unknown] - (S @ W @ flexible).T @ (W @ flexible @ force[0, unknown])
    np.testing.assert_allclose(turned.solve(force)[0, unknown], expected, atol=1e-9 * np.abs(expected).max())


def held_end(material: str) -> tuple[Compliance, Indices]:
    """The compliance of a beam of three coordinates, and vertices at its end to be pulled at."""
    body = scene(beam_mesh(0.3, 0.1, 0.1, 1), material, gravity=(0.0, 0.0, 0.0))
    return Compliance(body, modes(body, 3)), np.flatnonzero(body.mesh.vertices[:, 0] > 0.29)[:2]


def in_equilibrium(relaxation: Relaxation, vertices: Indices, force: Array) -> Array:
    """What a force on the centroid moves where the coordinates are held at zero, by Newton's method, (n, 3)."""
    body = relaxation.scene
    _, M, unknown = rest_matrices(body)
    W, load = relaxation.coordinates.matrix[unknown].T @ M, np.zeros((body.mesh.n_vertices, 3))
    load[vertices] = force / len(vertices)
    u, none = np.zeros(load.size), np.zeros((len(W), len(W)))
    for _ in range(8):
        out = -load
        add_elastic_gradient(body.elements, u.reshape(load.shape), out)
        K = relaxation.stiffness(u.reshape(load.shape)).toarray()[np.ix_(unknown, unknown)]
        right = np.concatenate([-out.ravel()[unknown], -W @ u[unknown]])
        u[unknown] += np.linalg.solve(np.block([[K, W.T], [W, none]]), right)[: len(unknown)]
    return np.asarray(u.reshape(load.shape))


@pytest.mark.parametrize("material", MATERIALS)
def test_a_dent_is_exact_to_second_order_in_its_force(material: str) -> None:
    compliance, vertices = held_end(material)
    unit = np.array([2.0, 1.0, 2.0]) / 3
    sizes = np.array([0.5, 1.0, 2.0]) * 2e-3 / np.linalg.norm(compliance.dent(vertices).compliance @ unit)
    errors = []
    for size in sizes:
        exact = in_equilibrium(compliance.relaxation, vertices, size * unit)
        found = compliance.moved(vertices, np.zeros_like(exact), size * unit)
        linear = compliance.of_grab(vertices) @ (size * unit)
        errors.append(np.abs(found - exact).max())
        # the centroid's is that of the law that the springs have
        dent = compliance.dent(vertices)
        law = dent.compliance @ (size * unit) + 0.5 * dent.second @ (size * unit) @ (size * unit)
        np.testing.assert_allclose(found[vertices].mean(axis=0), law, rtol=1e-6)
    if material == "linear":
        assert errors[-1] < 1e-9 * np.abs(exact).max()
    else:
        assert order(errors, sizes) > 2.7
        assert errors[-1] < 0.2 * np.abs(linear - exact).max()


@pytest.mark.parametrize("material", MATERIALS)
def test_where_the_coordinates_have_moved_the_compliance_is_exact_to_first_order(material: str) -> None:
    compliance, vertices = held_end(material)
    relaxation, body, dent = compliance.relaxation, compliance.scene, compliance.dent(vertices)
    sizes, errors, left = np.array([0.02, 0.04, 0.08]), [], []
    _, M, unknown = rest_matrices(body)
    W, load = relaxation.coordinates.matrix[unknown].T @ M, np.zeros((*body.mesh.vertices.shape, 3))
    load[vertices] = np.eye(3) / len(vertices)
    for size in sizes:
        pose = relaxation(size * bent_z(relaxation))
        K = relaxation.stiffness(pose.u).toarray()[np.ix_(unknown, unknown)]
        right = np.vstack([load.reshape(-1, 3)[unknown], np.zeros((len(W), 3))])
        moved = np.linalg.solve(np.block([[K, W.T], [W, np.zeros((len(W), len(W)))]]), right)[: len(unknown)]
        exact = load.reshape(-1, 3)[unknown].T @ moved
        F = (body.mesh.vertices + pose.u).T @ compliance.arms(vertices)
        A = warp(F)
        errors.append(np.abs(A @ (dent.compliance + dent.change(1.0, pose.z)) @ A.T - exact).max())
        left.append(np.abs(A @ dent.compliance @ A.T - exact).max())
    assert order(errors, sizes) > 1.8
    assert errors[0] < 0.3 * left[0]


def test_beyond_what_third_derivatives_tell_a_dent_goes_on_along_its_tangent(relaxation: Relaxation) -> None:
    compliance = Compliance(relaxation.scene, relaxation.coordinates)
    dent = compliance.dent(np.flatnonzero(relaxation.scene.mesh.vertices[:, 0] > 0.29)[:3])
    unit = np.array([0.0, 0.6, 0.8])
    changed = np.linalg.norm(dent.root @ (dent.second @ unit) @ dent.root)
    size = MOST_CHANGED / changed  # of the force whose change is the most that is taken

    def moved(force: Array) -> Array:
        amounts = dent.amounts(force, np.zeros((3, 3)))
        pairs = 0.5 * dent.second[:, [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        return np.asarray(dent.compliance @ amounts[:3] + 2 * pairs @ amounts[3:])

    def slope(times: float) -> Array:
        return (moved((times + 1e-5) * size * unit) - moved((times - 1e-5) * size * unit)) / (2e-5 * size)

    np.testing.assert_allclose(slope(1.5), slope(3.0), rtol=1e-6)
    np.testing.assert_allclose(slope(0.999), slope(1.5), rtol=1e-2)
    np.testing.assert_allclose(slope(0.5), (dent.compliance + 0.5 * size * dent.second @ unit) @ unit, rtol=1e-6)


def test_statics_under_a_grab_are_those_of_the_full_space_to_first_order() -> None:
    """With its residual compliance, the condensed pose under a spring is off by the square of the displacement."""
    body = beam()
    relaxation = Relaxation(body, modes(body, 3))
    compliance = Compliance(body, relaxation.coordinates)
    vertices = np.flatnonzero(body.mesh.vertices[:, 0] > 0.29)[:2]
    full = FullStepper(body, FullOptions(quasistatic=True, tolerance=1e-10))
    sizes, errors = np.array([1e-3, 2e-3, 4e-3]), []
    for size in sizes:
        grab = Grab(vertices, body.mesh.vertices[vertices].mean(axis=0) + [0.0, size, size], 50.0)
        u = full.step(full.rest(), Loads((grab,)))[0].u
        B = relaxation.rest.tangents[vertices].mean(axis=0)
        Q = np.linalg.inv(np.eye(3) / grab.stiffness + compliance.between([vertices]))
        stretch = np.array([0.0, size, size])
        z = np.linalg.solve(relaxation.rest.stiffness + B.T @ Q @ B, B.T @ Q @ stretch)
        drawn = relaxation.rest.tangents @ z + compliance.of_grab(vertices) @ (Q @ (stretch - B @ z))
        errors.append(np.abs(drawn - u).max())
    assert order(errors, sizes) > 1.8
    assert errors[0] < 0.02 * sizes[0]


def test_a_solid_without_pins_is_refused() -> None:
    held = beam()
    with pytest.raises(SolverError, match="at pins"):
        Relaxation(held, Basis.of(np.eye(3 * held.mesh.n_vertices)[:, :2], held.mass))
