"""Dead loads: resultants and moments of uniform loads, and the balance of pressure on a closed surface."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from ldsim.errors import SceneError
from ldsim.mechanics.dead_loads import load_force
from ldsim.mechanics.options import LoadOptions
from ldsim.mechanics.quadrature import quadrature
from ldsim.mechanics.regions import Ball, Box, Region, Slab
from ldsim.mesh.mesh import Mesh
from ldsim.mesh.shapes import beam, cross
from tests.helpers import scene

CELL_TYPES = pytest.mark.parametrize("cell_type", ["tet4", "hex8"])
ALL = Region(ball=Ball(centre=(0, 0, 0), radius=9))


def on_surface(mesh: Mesh, where: Region, **load: Any) -> NDArray[np.float64]:
    """The force of a load that does not ask for the density."""
    return load_force(mesh, np.full(mesh.n_cells, np.nan), LoadOptions(where=where, **load))


@CELL_TYPES
def test_a_body_force_is_mass_times_acceleration_in_its_region(cell_type: str) -> None:
    mesh = beam(0.4, 0.1, 0.1, 2, cell_type)
    density = np.where(mesh.vertices[mesh.cells].mean(axis=1)[:, 0] < 0.2, 500.0, 2000.0)
    b = (1.0, -2.0, 3.0)
    middle = Region(box=Box(min=(0.1, -1, -1), max=(0.3, 1, 1)))
    force = load_force(mesh, density, LoadOptions(where=middle, acceleration=b))
    mass = (500.0 + 2000.0) * 0.1 * 0.1 * 0.1
    np.testing.assert_allclose(force.sum(axis=0), mass * np.array(b), rtol=1e-12)
    assert not force[(mesh.vertices[:, 0] < 0.1 - 1e-9) | (mesh.vertices[:, 0] > 0.3 + 1e-9)].any()


@CELL_TYPES
def test_a_traction_sums_to_itself_times_the_area_and_acts_at_the_middle_of_the_face(cell_type: str) -> None:
    mesh = beam(0.4, 0.2, 0.1, 2, cell_type)
    t = np.array([10.0, -20.0, 5.0])
    force = on_surface(mesh, Region(slab=Slab(axis="x", at="max", thickness=1e-6)), traction=tuple(t))
    np.testing.assert_allclose(force.sum(axis=0), 0.02 * t, rtol=1e-12)
    moment = np.cross(mesh.vertices, force).sum(axis=0)
    np.testing.assert_allclose(moment, np.cross([0.4, 0, 0], 0.02 * t), atol=1e-12)
    assert not force[mesh.vertices[:, 0] < 0.4 - 1e-9].any()


@CELL_TYPES
def test_pressure_pushes_inwards(cell_type: str) -> None:
    mesh = beam(0.4, 0.2, 0.1, 1, cell_type)
    force = on_surface(mesh, Region(slab=Slab(axis="y", at="max", thickness=1e-6)), pressure=50.0)
    np.testing.assert_allclose(force.sum(axis=0), [0, -50 * 0.4 * 0.2, 0], atol=1e-12)


@CELL_TYPES
def test_pressure_all_around_has_no_resultant_and_no_moment_and_the_volume_as_its_virial(cell_type: str) -> None:
    # divergence theorem: ∮ p n dA = 0, ∮ x × p n dA = 0, ∮ x · n dA = 3 V; the X has curved, skew faces
    mesh = cross(resolution=2, cell_type=cell_type)
    force = on_surface(mesh, ALL, pressure=100.0)
    size = np.abs(force).sum()
    np.testing.assert_allclose(force.sum(axis=0), 0, atol=1e-12 * size)
    np.testing.assert_allclose(np.cross(mesh.vertices, force).sum(axis=0), 0, atol=1e-12 * size)
    volume = quadrature(mesh).weights.sum()
    assert -np.vdot(mesh.vertices, force) == pytest.approx(100 * 3 * volume, rel=1e-9)


def test_pinned_vertices_feel_neither_weight_nor_load() -> None:
    mesh = beam(0.4, 0.1, 0.1, 2)
    load = np.random.default_rng(0).normal(size=mesh.vertices.shape)
    body = replace(scene(mesh), load=load)
    force = body.force(np.array([1.0, -2.0, 3.0]))
    assert not force[body.pinned].any()
    weight = body.mass.sum(axis=1)[:, None] * [1.0, -2.0, 3.0]
    np.testing.assert_allclose(force[body.free], (weight + load)[body.free], rtol=1e-12)


def test_a_load_on_no_face_is_refused() -> None:
    with pytest.raises(SceneError, match="holds no face of the surface"):
        on_surface(beam(resolution=1), Region(ball=Ball(centre=(0, 0, 0), radius=1e-3)), traction=(1, 0, 0))
    with pytest.raises(SceneError, match="loads no cell"):
        mesh, nowhere = beam(resolution=1), Region(ball=Ball(centre=(9, 0, 0), radius=1e-3))
        load_force(mesh, np.ones(mesh.n_cells), LoadOptions(where=nowhere, acceleration=(1, 0, 0)))
