"""Virtual points: targets against slow sums, the gradient against finite differences, and what the fit reaches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from ldsim.cubature.choose import ClosedSamples, Judge, PoseSplit, choose_on_mesh, choose_virtual
from ldsim.cubature.options import FitOptions, VirtualOptions
from ldsim.cubature.path import RulePath, VirtualFit
from ldsim.cubature.rule import CubatureRule
from ldsim.cubature.samples import PoseSpace, rest_compliance
from ldsim.cubature.virtual import MovablePoints, Targets, fit_virtual, virtual_error
from ldsim.dynamics.reduced.matrices import reduced_rest_stiffness
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.errors import SolverError
from ldsim.mechanics.elastic import add_elastic_gradient
from ldsim.mechanics.loads import Loads
from ldsim.mechanics.materials import MATERIALS
from ldsim.space.lifting import Lifting
from tests.cubature.cubature_problems import beam_scene, latent_problem, two_materials

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

FITTED, KEPT_BACK, EVERY = np.arange(0, 40), np.arange(40, 60), np.arange(60)
OPTIONS = VirtualOptions(points=6, poses=40, steps=400, batch=32, rate=1e-2)


def made(material: str = "stable_neo_hookean", cell_type: str = "tet4") -> PoseSpace:
    """Poses of a small beam whose true selves are two per cent larger."""
    scene = beam_scene((5, 2, 2), cell_type, material)
    p = latent_problem(scene, r=3, k=8, count=60)
    poses = (p.decoder(p.z) @ p.U.T).reshape(60, -1, 3)
    stiffness = reduced_rest_stiffness(scene, p.space().reduced_basis)
    return PoseSpace(p.space(), stiffness, p.z, lambda t: 1.02 * poses[t], threads=1)


def lifted(space: PoseSpace) -> PoseSpace:
    """With two fields of moving pins beside U."""
    rng = np.random.default_rng(5)
    fields = 0.02 * rng.standard_normal((len(space.U), 2))
    lifting = Lifting(fields, (), space.scene.pinned)
    return replace(space, space=space.space.with_lifting(lifting), given=0.3 * rng.standard_normal((60, 2)))


def rules_of(space: PoseSpace, points: int) -> RulePath:
    """Rules on the mesh of at most so many points."""
    return choose_on_mesh(space, PoseSplit(FITTED[:30], KEPT_BACK, 60), FitOptions(tolerance=1e-6, max_points=points))


def virtual(
    space: PoseSpace,
    path: RulePath,
    options: VirtualOptions = OPTIONS,
    judge: Judge | None = None,
    split: PoseSplit = PoseSplit(FITTED, KEPT_BACK, 60),
) -> VirtualFit:
    return choose_virtual(space, path, split, options, judge)


def but(**changes: object) -> VirtualOptions:
    """Other options than `OPTIONS` in some."""
    return OPTIONS.replace(**changes)


def path_of(*rules: CubatureRule) -> RulePath:
    return RulePath(rules, len(rules) - 1)


@pytest.fixture(scope="module")
def space() -> PoseSpace:
    return made()


def at(space: PoseSpace, points: Indices, closure: float, poses: Indices, seed: int) -> tuple[Targets, Targets]:
    """Targets at poses and at near states of them."""
    rule = CubatureRule(points, np.ones(len(points)), 1.0)
    return ClosedSamples.of(space, poses, (seed,)).targets(space, rule, closure)


def start(space: PoseSpace, points: int, seed: int = 0) -> CubatureRule:
    rng, volume = np.random.default_rng(seed), space.scene.points.weights.sum()
    chosen = np.sort(rng.choice(space.scene.points.n_points, points, replace=False))
    return CubatureRule(chosen, rng.uniform(0.5, 1.5, points) * volume / points, 1.0)


def force(space: PoseSpace, u: Array) -> Array:
    """Uᵀ f of one displacement."""
    gradient = np.zeros((space.scene.mesh.n_vertices, 3))
    add_elastic_gradient(space.scene.elements, np.ascontiguousarray(u).reshape(-1, 3), gradient)
    return space.basis.T @ gradient.ravel()


@pytest.mark.parametrize("closure", [0.0, 0.4, 1.0])
def test_targets_are_the_forces_between_decoded_and_true_poses(space: PoseSpace, closure: float) -> None:
    targets, _ = at(space, EVERY[:3], closure, KEPT_BACK, 1)
    W = rest_compliance(space.stiffness, space.decoder, space.z)
    expected = []
    for t in KEPT_BACK:
        decoded = force(space, space.U @ space.decoder(space.z[t]))
        true = force(space, space.displacement(t))
        expected.append(W.T @ space.decoder.jacobian(space.z[t]).T @ (decoded + closure * (true - decoded)))
    norms = np.linalg.norm(expected, axis=1)
    scales = np.maximum(norms, 0.05 * np.median(norms))
    np.testing.assert_allclose(targets.force, np.array(expected) / scales[:, None], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(targets.q, space.decoder(space.z[KEPT_BACK]))


def test_near_states_keep_the_difference_of_their_pose(space: PoseSpace) -> None:
    plain, shifted = (at(space, EVERY[:3], closure, KEPT_BACK, 7)[1] for closure in (0.0, 1.0))
    np.testing.assert_array_equal(plain.q, shifted.q)
    distance = np.linalg.norm(plain.q - space.decoder(space.z[KEPT_BACK]), axis=1)
    assert distance.min() > 0
    for t, pose in enumerate(KEPT_BACK):
        decoded, true = space.U @ space.decoder(space.z[pose]), space.displacement(pose)
        excess = force(space, true) - force(space, decoded)
        expected = force(space, space.U @ plain.q[t]) + excess
        # the projection is J W / scale, so its own scale cancels
        np.testing.assert_allclose(shifted.projection[t].T @ expected, shifted.force[t], rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.parametrize("moving", [False, True], ids=["still", "moving pins"])
def test_the_gradient_is_that_of_finite_differences(material: str, moving: bool) -> None:
    space = lifted(made(material)) if moving else made(material)
    first = start(space, 4)
    targets = Targets.joined(*at(space, first.points, 1.0, EVERY[:9], 0))
    points, states = MovablePoints(space, first), np.arange(len(targets))
    maps, weights = points.maps.copy(), points.weights.copy()
    rng = np.random.default_rng(2)
    of_maps, of_logarithms = points.gradient(targets, states)
    for _ in range(3):
        along = rng.standard_normal(maps.shape) * np.sqrt((maps**2).mean(axis=(0, 1)))
        growth = rng.standard_normal(weights.shape)
        losses = []
        for step in (1e-6, -1e-6):
            points.maps, points.weights = maps + step * along, weights * np.exp(step * growth)
            losses.append((points.residuals(targets, states)[0] ** 2).sum() / len(states))
        slope = (losses[0] - losses[1]) / 2e-6
        assert slope == pytest.approx(float((of_maps * along).sum() + of_logarithms @ growth), rel=1e-5)


def test_all_points_of_the_mesh_meet_targets_at_decoded_poses_exactly() -> None:
    plain = made()
    space = replace(plain, space=replace(plain.space, scene=two_materials(plain.scene)))
    targets, near = at(space, np.arange(space.scene.points.n_points), 0.0, EVERY, 0)
    every = CubatureRule.every(space.scene)
    assert virtual_error(space, every, targets) < 1e-12
    assert virtual_error(space, every, near) < 1e-12


@pytest.mark.parametrize("cell_type", ["tet4", "hex8"])
def test_the_fit_makes_a_few_points_several_times_as_good_on_poses_it_has_not_seen(cell_type: str) -> None:
    space = made(cell_type=cell_type)
    path = rules_of(space, 6)
    before, after = path.best, virtual(space, path, but(closures=(0.0,))).rule
    assert len(after.points) == 6
    assert after.heldout_error < 0.4 * before.heldout_error
    assert after.perturbed_error < 0.4 * before.perturbed_error
    assert after.maps is not None
    assert (after.weights > 0).all()


def test_with_a_closure_the_forces_of_the_true_poses_are_met(space: PoseSpace) -> None:
    path = rules_of(space, 12)
    closed = virtual(space, path, but(points=12, closures=(1.0,))).rule
    judge, _ = at(space, path.best.points, 1.0, KEPT_BACK, 0)
    assert virtual_error(space, closed, judge) == pytest.approx(closed.heldout_error)
    exact = virtual_error(space, CubatureRule.every(space.scene), judge)
    assert closed.heldout_error < 0.7 * min(exact, virtual_error(space, path.best, judge))


def test_moving_pins_strain_virtual_points_too() -> None:
    space = lifted(made())
    first = start(space, 5)
    fitted = Targets.joined(*at(space, first.points, 0.0, FITTED, 0))
    kept, _ = at(space, first.points, 0.0, KEPT_BACK, 1)
    assert fitted.strain is not None
    found = fit_virtual(space, first, (fitted, kept), OPTIONS, 0)
    assert virtual_error(space, found, kept) < 0.5 * virtual_error(space, first, kept)
    still = replace(kept, strain=None)
    assert virtual_error(space, found, still) > 2 * virtual_error(space, found, kept)


def test_a_solid_of_virtual_points_rests_at_rest(space: PoseSpace) -> None:
    found = virtual(space, rules_of(space, 6)).rule
    weightless = replace(space.scene, gravity=np.zeros(3))
    stepper = ReducedStepper(replace(space.space, scene=weightless, rule=found))
    state, solution = stepper.step(stepper.rest(), Loads())
    assert solution.iterations == 0
    assert not state.q.any()


def test_the_best_seen_is_kept_and_progress_is_told(space: PoseSpace) -> None:
    first = start(space, 4)
    fitted = Targets.joined(*at(space, first.points, 0.0, FITTED, 0))
    kept, _ = at(space, first.points, 0.0, KEPT_BACK, 1)
    seen: list[tuple[int, float]] = []
    wild = but(rate=0.5, steps=60)
    found = fit_virtual(space, first, (fitted, kept), wild, 0, lambda *told: seen.append(told))
    errors = [virtual_error(space, first, kept), *(error for _, error in seen)]
    assert seen[-1][0] == 60
    assert len(seen) == 20
    assert virtual_error(space, found, kept) == pytest.approx(min(errors), rel=1e-12)


def test_the_same_seed_gives_the_same_points(space: PoseSpace) -> None:
    path, options = path_of(start(space, 4)), but(steps=30)
    some, again, other = (
        virtual(space, path, options, split=PoseSplit(FITTED, KEPT_BACK, 30, seed)).rule.maps for seed in (0, 0, 1)
    )
    np.testing.assert_array_equal(some, again)
    assert not np.array_equal(some, other)


def test_a_state_of_infinite_energy_is_an_infinite_error_and_pulls_no_other_apart() -> None:
    space = made("neo_hookean")
    first = start(space, 3)
    targets, _ = at(space, first.points, 0.0, EVERY[:5], 0)
    inverted = replace(targets, q=np.vstack([-400 * targets.q[:1], targets.q[1:]]))
    assert virtual_error(space, first, inverted) == np.inf
    points = MovablePoints(space, first)
    assert np.isfinite(points.gradient(inverted, np.arange(5))[0]).all()
    with pytest.raises(SolverError, match="start from points that are inverted in a pose"):
        fit_virtual(space, first, (targets, inverted), OPTIONS, 0)


def test_bad_input_is_refused(space: PoseSpace) -> None:
    with pytest.raises(SolverError, match="need two poses besides those kept back; there are 1"):
        virtual(space, path_of(start(space, 3)), split=PoseSplit(FITTED, EVERY[1:], 60))
    first = start(space, 3)
    with pytest.raises(SolverError, match=r"strain maps of shape \(2, 9, 8\); must be \(3, 9, k\)"):
        replace(first, maps=np.zeros((2, 9, 8)))
    with pytest.raises(SolverError, match="strain maps that are not finite"):
        replace(first, maps=np.full((3, 9, 8), np.nan))
    with pytest.raises(SolverError, match="strain maps of 5 columns; the basis has 8"):
        replace(first, maps=np.zeros((3, 9, 5))).strain_maps(space.scene, space.U)


@pytest.mark.parametrize("best", [0.0, 0.5, 1.0])
def test_the_closure_that_is_judged_best_is_taken(space: PoseSpace, best: float) -> None:
    path, closures = path_of(start(space, 3), start(space, 5)), (0.0, 0.5, 1.0)
    errors = iter([*(abs(best - closure) + 0.1 for closure in closures), 0.2])
    options = but(points=3, steps=10, closures=closures)
    judged: list[CubatureRule] = []

    def judge(rule: CubatureRule) -> float:
        judged.append(rule)
        return next(errors)

    found = virtual(space, path, options, judge)
    assert found.closure == best
    assert found.rule.maps is judged[closures.index(best)].maps
    assert judged[-1] is path.best
    np.testing.assert_allclose(found.judged[1:, 0], closures)
    assert found.judged[0, 1] == 0.2
    assert not found.worse_than_mesh


def test_of_closures_that_are_nearly_as_good_the_largest_is_taken(space: PoseSpace) -> None:
    options = but(points=3, steps=10, closures=(0.0, 0.5, 1.0))
    errors = iter([0.1, 0.108, 0.112, 0.2])
    assert virtual(space, path_of(start(space, 3)), options, lambda _: next(errors)).closure == 0.5


def test_the_closure_that_was_taken_is_what_is_worse_than_the_mesh(space: PoseSpace) -> None:
    """Not the best of those that were tried, which is not the one that is stepped."""
    errors = iter([1.0, 1.09, 0.92])
    found = virtual(
        space, path_of(start(space, 3)), but(points=3, steps=10, closures=(0.0, 1.0)), lambda _: next(errors)
    )
    assert found.closure == 1.0 and found.worse_than_mesh


def test_points_that_are_judged_worse_than_the_mesh_say_so_and_without_a_judge_the_first_closure_is_taken(
    space: PoseSpace,
) -> None:
    path, options = path_of(start(space, 3)), but(points=3, steps=10, closures=(1.0, 0.0))
    errors = iter([0.3, 0.2, 0.17])
    assert virtual(space, path, options, lambda _: next(errors)).worse_than_mesh
    found = virtual(space, path, options)
    assert found.closure == 1.0
    assert not found.worse_than_mesh
