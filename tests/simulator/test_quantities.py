"""What the simulator tells besides shape: velocity, energy, stress, centre of mass."""

from __future__ import annotations

import numpy as np
import pytest

from ldsim.simulator import full_simulator
from tests.simulator.simulators import BODY, TIP, UP, every_kind, kinds


@kinds
def test_velocity_is_what_a_step_moved_over_its_time(kind: int) -> None:
    simulator = every_kind()[kind]
    assert not simulator.velocity().any()
    simulator.grab(TIP, TIP + UP)
    simulator.step(3)
    before, some = simulator.displacement(), np.array([4, 2])
    simulator.step()
    speed = (simulator.displacement() - before) / BODY.time_step
    assert np.abs(speed).max() > 1e-3
    np.testing.assert_allclose(simulator.velocity(), speed, atol=1e-9)
    np.testing.assert_array_equal(simulator.velocity(some), simulator.velocity()[some])
    np.testing.assert_array_equal(simulator.displacement(some), simulator.displacement()[some])


def test_energy_and_centre_of_mass_are_those_of_the_whole_mesh() -> None:
    simulator = full_simulator(BODY)
    mass = BODY.vertex_mass
    np.testing.assert_allclose(simulator.centre_of_mass, mass @ BODY.mesh.vertices / mass.sum())
    assert simulator.elastic_energy == pytest.approx(0, abs=1e-12) and simulator.stress().max() < 1e-6
    simulator.step(20)  # it sags
    sunk = mass @ simulator.displacement() / mass.sum()
    np.testing.assert_allclose(simulator.centre_of_mass, mass @ BODY.mesh.vertices / mass.sum() + sunk)
    work = mass.sum() * float(BODY.gravity @ sunk)
    assert 0 < simulator.elastic_energy < work  # of the weight
    assert simulator.stress().shape == (BODY.mesh.n_vertices,) and simulator.stress().max() > 1
