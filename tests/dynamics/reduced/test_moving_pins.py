"""Moving pins: against the full space, and against a basis that holds their displacement."""

from __future__ import annotations

import numpy as np
import pytest

from ldsim.dynamics.reduced.tangent import current_tangent
from ldsim.dynamics.simulate import simulate
from ldsim.errors import MotionError
from ldsim.mechanics.loads import Loads
from ldsim.mechanics.scene import Scene
from ldsim.optimise.solution import Reason
from ldsim.space.decoder import Decoder
from ldsim.space.lifting import Lifting
from tests.dynamics.reduced.solids import HEX, TET, full_basis, full_stepper, placed, pull, shaken, stepper
from tests.helpers import smooth_basis


@pytest.mark.parametrize("body", [TET, HEX], ids=["tet4", "hex8"])
def test_pins_that_move_are_followed_as_in_the_full_space(body: Scene) -> None:
    U, motion = full_basis(body), shaken(body, 6)
    lifting = Lifting.of(body, [motion])
    linear = stepper(body, U, Decoder.identity(U.shape[1]), tolerance=1e-9, lifting=lifting)
    full = full_stepper(body)
    state, whole = linear.rest(), full.rest()
    for frame in range(6):
        loads = (pull(body) if frame > 1 else Loads())._replace(pins=placed(motion, frame))
        state, solution = linear.step(state, loads)
        assert solution.reason == Reason.CONVERGED
        whole, _ = full.step(whole, loads)
        np.testing.assert_allclose(linear.displacement(state), whole.u, atol=1e-8)
        np.testing.assert_allclose(linear.space.fields @ linear.coordinates(state), whole.u, atol=1e-8)
    assert np.abs(whole.u[body.pinned]).max() > 0.005


def test_a_latent_space_that_is_linear_follows_moving_pins_as_the_linear_one() -> None:
    U, motion = smooth_basis(TET, 6), shaken(TET, 6)
    lifting = Lifting.of(TET, [motion])
    flat = Decoder.network([np.zeros((6, 3)), np.zeros((3, 6))], [np.ones(3), np.ones(6)], "elu", np.eye(6))
    ends = []
    for decoder in (Decoder.identity(6), flat):
        some = stepper(TET, U, decoder, tolerance=1e-10, lifting=lifting)
        state = some.rest()
        for frame in range(6):
            state, solution = some.step(state, pull(TET)._replace(pins=placed(motion, frame)))
            assert solution.reason == Reason.CONVERGED
        ends.append(state.q)
    np.testing.assert_allclose(ends[1], ends[0], atol=1e-9)
    assert np.abs(ends[0]).max() > 1e-3


def test_the_tangent_under_moving_pins_is_that_of_a_basis_that_holds_their_displacement() -> None:
    U, motion = smooth_basis(TET, 6), shaken(TET, 1)
    lifting = Lifting.of(TET, [motion])
    a, q = lifting.coordinates(motion)[0], np.linspace(-0.01, 0.01, 6)
    lifted = stepper(TET, U, Decoder.identity(6), lifting=lifting)
    lifted.step(lifted.rest(), Loads(pins=placed(motion, 0)))
    both = stepper(TET, np.hstack([U, lifting.fields]), Decoder.identity(6 + lifting.count))
    hessians = []
    for some, coordinates in ((lifted, q), (both, np.concatenate([q, a]))):
        model, _, work = some.compiled()
        work.q[:] = coordinates
        current_tangent(model, work)
        hessians.append(work.hessian)
    np.testing.assert_allclose(hessians[0], hessians[1][:6, :6], rtol=1e-9, atol=1e-9)


def test_pins_that_a_space_was_not_prepared_for_are_refused() -> None:
    some = stepper(TET, smooth_basis(TET, 6), Decoder.identity(6))
    with pytest.raises(MotionError, match="pins move; the reduced space has no lifting for them"):
        list(simulate(some, shaken(TET, 2)))
