"""Colours: against a slow loop, and in a state of known stress."""

from __future__ import annotations

import numpy as np
import pytest

from ldsim.arrays import Array
from ldsim.mechanics.materials.kernels import energy_stress
from ldsim.simulator import full_simulator
from ldsim.simulator.fields import FIELDS, VertexField
from tests.helpers import bent
from tests.simulator.playable import solid


def slow(u: Array) -> Array:
    """Energy and von Mises stress of every quadrature point, (2, s)."""
    elements = SIMULATOR.scene.elements
    values = np.empty((2, len(elements.weights)))
    for s in range(len(elements.weights)):
        F = np.eye(3) + np.einsum("ai,aj->ij", u[elements.nodes[s]], elements.gradients[s])
        density, P = energy_stress(elements.kind[s], tuple(F.ravel()), elements.mu[s], elements.lam[s])
        cauchy = np.reshape(P, (3, 3)) @ F.T / np.linalg.det(F)
        deviator = cauchy - np.trace(cauchy) / 3 * np.eye(3)
        values[:, s] = density, np.sqrt(1.5 * np.sum(deviator**2))
    return values


SIMULATOR = full_simulator(solid(1))


@pytest.mark.parametrize("field", FIELDS)
def test_a_field_is_the_average_by_volume_of_the_points_around_a_vertex(field: str) -> None:
    u = bent(SIMULATOR.scene.mesh)
    values, elements = slow(u)[FIELDS.index(field)], SIMULATOR.scene.elements
    for i, value in enumerate(VertexField(SIMULATOR.scene, SIMULATOR.surface.vertices)(field, u, 3.0)):
        around = (elements.nodes == SIMULATOR.surface.vertices[i]).any(axis=1)
        expected = 3 * np.average(values[around], weights=elements.weights[around])
        np.testing.assert_allclose(value, expected, rtol=1e-10)


@pytest.mark.parametrize("field", FIELDS)
def test_an_inverted_cell_is_seen_at_its_own_vertices_alone(field: str) -> None:
    scene, u = SIMULATOR.scene, np.zeros((SIMULATOR.scene.mesh.n_vertices, 3))
    tip = scene.mesh.vertices[:, 0].argmax()
    u[tip, 0] = -0.9 * np.ptp(scene.mesh.vertices[:, 0])
    with np.errstate(all="ignore"):
        forbidden = ~np.isfinite(slow(u)[0])
    of_it = np.unique(scene.elements.nodes[forbidden])
    some = np.argsort(scene.mesh.vertices[:, 0])[::2]  # cells have other vertices too
    found = VertexField(scene, some)(field, u, 1.0)
    assert 0 < np.isin(some, of_it).sum() < len(some)
    np.testing.assert_array_equal(np.isfinite(found), ~np.isin(some, of_it))


@pytest.mark.parametrize("field", FIELDS)
def test_a_solid_at_rest_has_none(field: str) -> None:
    u = np.zeros((SIMULATOR.scene.mesh.n_vertices, 3))
    np.testing.assert_allclose(VertexField(SIMULATOR.scene, SIMULATOR.surface.vertices)(field, u, 1.0), 0.0, atol=1e-8)
