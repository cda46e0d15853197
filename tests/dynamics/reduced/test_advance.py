"""Where a step starts, and what it keeps of earlier ones."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ldsim.dynamics.reduced.advance import extrapolate
from ldsim.dynamics.reduced.state import ReducedState, fields
from ldsim.dynamics.reduced.stepper import ReducedStepper
from tests.dynamics.reduced.solids import TET, curved, pull, run, stepper
from tests.helpers import smooth_basis

Array = NDArray[np.float64]


def test_a_step_that_does_not_extrapolate_starts_where_the_last_one_ended() -> None:
    """So a solid that is in equilibrium already needs no iteration, whatever its last change was."""
    for goes_on in (False, True):
        some = stepper(TET, smooth_basis(TET, 6), curved(6, 4), quasistatic=True, extrapolate=goes_on)
        state = some.rest()
        for reach in (0.01, 0.02, 0.03, 0.03):
            state, solution = some.step(state, pull(TET, reach))
        assert (solution.iterations == 0) is not goes_on


def test_the_guess_follows_a_polynomial_and_falls_back_after_a_jolt() -> None:
    some = stepper(TET, smooth_basis(TET, 6), curved(6, 4))
    t = np.arange(9.0)
    path = np.stack([np.ones(9), t, t**3 - 4 * t**2, 0.1 * t**5], axis=1)
    guesses = [state.guess for state in along(some, path)]
    np.testing.assert_allclose(guesses[-2], path[-1], rtol=1e-9)
    jolted = path.copy()
    jolted[-1] += 1e6
    last = along(some, jolted)[-1]
    np.testing.assert_allclose(last.guess, jolted[-1])  # standing still is the best that is known


def along(some: ReducedStepper, path: Array) -> list[ReducedState]:
    """States whose z went along a path, whatever the forces are."""
    states = [some.rest()]
    for z in path:
        data = np.empty(states[-1].room(0))
        new = ReducedState(data, (some.rest().r, some.rest().k))
        before, now = (fields.py_func(state.data, new.r, new.k) for state in (states[-1], new))  # type: ignore[attr-defined]
        now[0][:], now[1][:] = z, before[0]
        extrapolate(before[1], before[0], z, before[6], now[6], now[2])
        states.append(new)
    return states[1:]


def test_a_quasi_static_step_forgets_how_fast_the_solid_was() -> None:
    some = stepper(TET, smooth_basis(TET, 6), curved(6, 4), tolerance=1e-10, quasistatic=True)
    moving = run(some, pull(TET), 3)[-1]
    ends = [some.step(state, pull(TET, 0.02))[0].q for state in (moving, moving.standing())]
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-8)
    assert np.abs(ends[0] - moving.q).max() > 1e-4
