"""Comparisons: a space that holds every motion has no error, restarts take effect, lost runs are shown."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from ldsim.dynamics.full.options import FullOptions
from ldsim.dynamics.full.stepper import FullStepper
from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.state import ReducedState
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.dynamics.simulate import simulate
from ldsim.dynamics.trajectory import Trajectory
from ldsim.mechanics.loads import Loads
from ldsim.mechanics.motion import Drag, Motion, Support
from ldsim.mechanics.scene import Scene, properties_of, with_properties
from ldsim.mesh.mesh import Mesh
from ldsim.mesh.shapes import beam
from ldsim.optimise.solution import Reason, Solution
from ldsim.pipeline.comparison import Measured, Reference, compare_motion, run_reduced, stretch, windowed_error
from ldsim.pipeline.options import SimulateOptions
from ldsim.space.basis import Basis, inner_product
from ldsim.space.pca import orthonormalised
from ldsim.space.space import Space
from tests.helpers import scene

Array = NDArray[np.float64]

BODY = scene(beam(resolution=1), youngs_modulus=3e4)
TIP = BODY.mesh.vertices[BODY.mesh.vertices[:, 0].argmax()]
PULL = Drag(3, TIP, np.tile(TIP + [0, 0.04, 0], (6, 1)), 0.02, 30.0)
MOTION = Motion("pull", 14, (PULL,))
OPTIONS, FULL_FRAMES = ReducedOptions(tolerance=1e-9, max_iterations=300), 5


def basis(columns: int | None = None) -> Array:
    unit = np.zeros((3 * BODY.mesh.n_vertices, 3 * len(BODY.free)))
    rows = (3 * BODY.free[:, None] + np.arange(3)).ravel()
    unit[rows, np.arange(len(rows))] = 1
    return np.ascontiguousarray(orthonormalised(unit, inner_product(BODY.mass, "mass")).matrix[:, :columns])


@pytest.fixture(scope="module")
def reference() -> Reference:
    return recorded(MOTION)


def recorded(motion: Motion, body: Scene = BODY, tolerance: float | None = 1e-9) -> Reference:
    """A motion as it runs in the full space."""
    frames = list(simulate(FullStepper(body, FullOptions(tolerance=tolerance)), motion))
    fields = np.array([frame.state.u for frame in frames], dtype=np.float32)
    return Reference(motion, frames[-1].held, lambda a, b: fields[a:b])


def whole(U: Array, body: Scene = BODY) -> Space:
    return Space.linear(body, Basis.of(U, body.mass), U.shape[1])


def compared(space: Space, reference: Reference) -> dict[str, Trajectory]:
    runs = compare_motion([space], reference, OPTIONS, Measured(FULL_FRAMES, 1e-9, 0.05), lambda: None)
    return {name: trajectory for name, trajectory, _ in runs}


def test_a_space_that_holds_every_motion_has_no_error(reference: Reference) -> None:
    linear = compared(whole(basis()), reference)["linear"]
    assert linear.max_error.max() < 1e-6
    assert linear.windowed_mean_error.max() < 1e-6
    assert not linear.diverged


def test_restarts_from_the_full_space_lower_the_error_of_a_poor_space(reference: Reference) -> None:
    linear = compared(whole(basis(20)), reference)["linear"]
    assert linear.windowed_mean_error.sum() < linear.mean_error.sum()


def test_a_windowed_error_is_how_far_off_and_how_far_it_goes(reference: Reference) -> None:
    space, moved = whole(basis(20)), np.linalg.norm(reference.frames(0, MOTION.frames), axis=2).mean(axis=1).sum()
    off, goes = windowed_error(space, reference, 0.05, OPTIONS)
    assert goes == pytest.approx(moved, rel=1e-6)
    assert off / goes == pytest.approx(compared(space, reference)["linear"].windowed_error, rel=1e-3)


def test_the_full_space_is_timed_from_the_first_grab_on(reference: Reference) -> None:
    full = compared(whole(basis(20)), reference)["full"]
    assert len(full.seconds) == FULL_FRAMES
    assert stretch(MOTION, 5) == range(3, 8)
    assert stretch(MOTION, 100) == range(14)


def test_with_another_material_the_spaces_run_it_and_nothing_is_judged(reference: Reference) -> None:
    softer = with_properties(BODY, properties_of(BODY).changed(youngs_factor=0.5))
    U = basis()
    runs = compared(whole(U, softer), replace(reference, frames=None))
    assert len(runs["full"].seconds) == FULL_FRAMES
    linear = runs["linear"]
    assert linear.mean_error is None and linear.windowed_mean_error is None and linear.coordinates is not None
    alone = simulate(FullStepper(softer, FullOptions(tolerance=1e-9)), MOTION, held=reference.held)
    for frame, q in zip(alone, linear.coordinates, strict=True):
        np.testing.assert_allclose((U @ q).reshape(-1, 3), frame.state.u, atol=1e-7)


def test_a_space_that_holds_every_motion_relative_to_pins_that_move_has_no_error() -> None:
    maps = np.tile(np.eye(3, 4), (14, 1, 1))
    maps[:, 2, 3] = 0.02 * np.sin(np.linspace(0, 4, 14))
    maps[:, 1, 0] = 0.3 * np.sin(np.linspace(0, 3, 14))
    shaken = Motion("shaken", 14, (PULL,), supports=(Support(np.flatnonzero(BODY.pinned), maps),))
    reference = recorded(shaken)
    linear = compared(whole(basis()), reference)["linear"]
    assert linear.max_error.max() < 1e-6
    assert linear.windowed_mean_error.max() < 1e-6
    assert reference.frames is not None
    moved = np.linalg.norm(reference.frames(0, 14).astype(float), axis=2).mean(axis=1)
    np.testing.assert_allclose(linear.mean_displacement, moved)


class LosesTheThirdStep(ReducedStepper):
    """Turns the solid inside out, whose energy is infinite, before its third step."""

    steps = 0

    def step(self, state: ReducedState, loads: Loads) -> tuple[ReducedState, Solution]:
        self.steps += 1
        if self.steps == 3:
            inverted = -2 * BODY.mesh.vertices
            inverted[BODY.pinned] = 0
            state = self.state(inverted, inverted)
        return super().step(state, loads)


def test_a_lost_run_ends_in_nan_and_counts_as_diverged() -> None:
    told: list[int] = []
    stepper = LosesTheThirdStep(whole(basis()))
    lost = run_reduced(stepper, Reference(MOTION, {}, None), progress=lambda: told.append(1))
    assert lost.diverged
    assert lost.coordinates is not None and len(lost.coordinates) == MOTION.frames
    assert np.isfinite(lost.coordinates[:2]).all() and np.isnan(lost.coordinates[2:]).all()
    assert (lost.reason[:2] == Reason.CONVERGED).all() and (lost.reason[2:] == Reason.INFINITE_START).all()
    assert np.isfinite(lost.seconds[:3]).all() and np.isnan(lost.seconds[3:]).all()
    assert len(told) == 2


def test_like_solids_of_a_millimetre_and_of_a_hundred_metres_take_nearly_as_many_iterations() -> None:
    """So that how much longer a step of the full space takes does not depend on the unit."""
    iterations = []
    for size in (2.5e-3, 1.0, 250.0):
        coarse = beam(resolution=1)
        mesh = Mesh(size * coarse.vertices, coarse.cells, coarse.cell_type)
        body = scene(mesh, youngs_modulus=1e5 * size, time_step=0.01 * math.sqrt(size))
        point = mesh.vertices[mesh.vertices[:, 0].argmax()]
        targets = point + size * np.linspace(0, 0.1, 15)[:, None] * [0.0, 1.0, 0.0]
        motion = Motion("up", 25, (Drag(0, point, targets, 0.05 * size, 30 * size**2),))
        x = (mesh.vertices[:, 0] - mesh.vertices[:, 0].min()) / size
        bends = np.concatenate([np.kron(x[:, None] ** power, np.eye(3)) for power in (1, 2, 3)], axis=1)
        space = whole(orthonormalised(bends, inner_product(body.mass, "mass")).matrix, body)
        full, reduced = SimulateOptions().stops(body.vertex_mass)
        measured, options = Measured(25, full, 0.25), ReducedOptions(tolerance=reduced)
        runs = compare_motion([space], recorded(motion, body, None), options, measured, lambda: None)
        iterations.append([trajectory.iterations[1:].mean() for _, trajectory, _ in runs])
    np.testing.assert_allclose(iterations, np.tile(iterations[1], (3, 1)), rtol=0.4)


def test_a_tolerance_that_is_given_holds_in_every_space_and_that_of_the_paper_where_none_is() -> None:
    assert SimulateOptions(tolerance=1e-5).stops(BODY.vertex_mass) == (1e-5, 1e-5)
    assert SimulateOptions().stops(BODY.vertex_mass) == (1e-8, 1e-8)


@pytest.mark.parametrize(("times", "of_weights", "of_reduced"), [(1e-12, 1e-6, 1e-7), (1e14, 1e-9, 1e-10)])
def test_of_a_very_light_or_heavy_solid_a_tolerance_is_a_share_of_what_acts_on_it(
    times: float, of_weights: float, of_reduced: float
) -> None:
    masses = times * BODY.vertex_mass
    weights = 9.8 * np.linalg.norm(masses), 9.8 * np.sqrt(masses.sum())
    assert SimulateOptions().stops(masses) == pytest.approx((of_weights * weights[0], of_reduced * weights[1]))
