"""Statics against published numbers and an independent library."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import skfem
from numpy.typing import NDArray
from skfem.models.elasticity import linear_elasticity

from ldsim.dynamics.full.options import FullOptions
from ldsim.dynamics.full.stepper import FullStepper
from ldsim.mechanics.loads import Loads
from ldsim.mechanics.scene import Scene
from ldsim.mesh.mesh import Mesh
from ldsim.mesh.shapes import beam
from tests.helpers import scene

Array = NDArray[np.float64]
STILL = (0.0, 0.0, 0.0)
# scikit-fem numbers the corners of a hexahedron in another order.
SKFEM_HEX = [0, 3, 4, 1, 7, 2, 5, 6]


def equilibrium(body: Scene) -> Array:
    """The equilibrium from rest, (n, 3) metres."""
    stepper = FullStepper(body, FullOptions(tolerance=1e-10, method="newton", quasistatic=True))
    state, solution = stepper.step(stepper.rest(), Loads())
    assert solution.converged, solution.reason.words
    return state.u


def cooks_membrane(cells: int) -> float:
    """Deflection of the middle of the free end, one layer of hexes thick."""
    box = beam(1.0, 1.0, 1.0, cells, "hex8")
    flat = box.vertices[:, 2] < box.vertices[:, 2].min() + 1 / cells + 1e-9
    number = np.cumsum(flat) - 1
    layer = box.cells[flat[box.cells].all(axis=1)]
    s, t, z = (box.vertices[flat] - box.vertices.min(axis=0)).T
    y = t * 44 * (1 - s) + s * (44 + 16 * t)
    mesh = Mesh(np.stack([48 * s, y, z * cells], axis=1), number[layer].astype(np.int32), "hex8")
    body = scene(mesh, "linear", youngs_modulus=1.0, poisson_ratio=1 / 3, gravity=STILL)
    end = np.flatnonzero(s > 1 - 1e-9)
    height = t[end]
    share = np.where((height < 1e-9) | (height > 1 - 1e-9), 0.5, 1.0)
    force = np.zeros_like(mesh.vertices)
    force[end, 1] = share / share.sum()
    u = equilibrium(replace(body, load=force))
    return float(u[end[np.abs(height - 0.5) < 1e-9], 1].mean())


def test_cooks_membrane_deflects_as_published() -> None:
    # Cook 1974, J. Struct. Div. ASCE 100: a tapered panel 48 long, 44 to 60 high, thickness 1, E = 1, ν = 1/3, plane
    # stress, clamped, a unit shear at its end. Deflection at mid-height of the end: 23.96 (Bergan and Felippa 1985).
    errors = [abs(cooks_membrane(cells) / 23.96 - 1) for cells in (8, 16, 24)]
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 0.02


def independent(body: Scene, youngs_modulus: float, poisson_ratio: float) -> Array:
    """The deflection of a linear elastic body under its weight by scikit-fem, (n, 3) metres."""
    hexes = body.mesh.cell_type == "hex8"
    cells = body.mesh.cells[:, SKFEM_HEX] if hexes else body.mesh.cells
    mesh_type, element = (skfem.MeshHex, skfem.ElementHex1()) if hexes else (skfem.MeshTet, skfem.ElementTetP1())
    mesh = mesh_type(body.mesh.vertices.T.copy(), cells.T.astype(np.int64).copy())
    np.testing.assert_array_equal(mesh.p.T, body.mesh.vertices)
    basis = skfem.Basis(mesh, skfem.ElementVector(element), intorder=3)
    lam = youngs_modulus * poisson_ratio / ((1 + poisson_ratio) * (1 - 2 * poisson_ratio))
    stiffness = linear_elasticity(lam, youngs_modulus / (2 * (1 + poisson_ratio))).assemble(basis)
    weight = skfem.LinearForm(lambda v, w: 1000.0 * -9.81 * v[1]).assemble(basis)
    held = basis.nodal_dofs[:, body.pinned].ravel()
    solved = skfem.solve(*skfem.condense(stiffness, weight, D=held))
    return solved[basis.nodal_dofs].T


@pytest.mark.parametrize("cell_type", ["tet4", "hex8"])
def test_a_beam_hangs_as_scikit_fem_says(cell_type: str) -> None:
    body = scene(beam(0.4, 0.1, 0.08, 3, cell_type), "linear", 1e5, 0.4)
    u = equilibrium(body)
    expected = independent(body, 1e5, 0.4)
    np.testing.assert_allclose(u, expected, rtol=0, atol=1e-6 * np.abs(expected).max())
