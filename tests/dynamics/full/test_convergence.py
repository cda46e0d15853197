"""The full space against solutions known in advance: patch test, manufactured solutions, refinement, spin."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from ldsim.dynamics.full.options import FullOptions
from ldsim.dynamics.full.stepper import FullState, FullStepper
from ldsim.mechanics.loads import Loads
from ldsim.mechanics.materials import MATERIALS
from ldsim.mechanics.materials.kernels import energy_stress
from ldsim.mechanics.pins import MovedPins
from ldsim.mechanics.quadrature import reference_points
from ldsim.mechanics.scene import Scene
from ldsim.mesh.mesh import Mesh
from ldsim.mesh.shapes import beam
from tests.helpers import order, scene

Array = NDArray[np.float64]
STILL = (0.0, 0.0, 0.0)
# The points of a rule of degree two on the tet, barycentric.
TET_RULE = np.full((4, 4), 0.1381966011250105) + 0.4472135954999579 * np.eye(4)
SOLVERS = [("lbfgs", "direct"), ("newton", "direct"), ("lbfgs", "multigrid"), ("newton", "multigrid")]


def inside(mesh: Mesh) -> NDArray[np.bool_]:
    """Vertices off the surface of a box."""
    x = mesh.vertices
    result: NDArray[np.bool_] = ((x > x.min(axis=0) + 1e-9) & (x < x.max(axis=0) - 1e-9)).all(axis=1)
    return result


def clamped_box(cells: int, cell_type: str, material: str, noise: float) -> Scene:
    """A unit cube whose whole surface is held, its inner vertices stirred by a share of the cells."""
    mesh = beam(1.0, 1.0, 1.0, cells, cell_type)
    free = inside(mesh)
    stir = noise / cells * np.random.default_rng(0).uniform(-1, 1, mesh.vertices.shape)
    stirred = Mesh(mesh.vertices + stir * free[:, None], mesh.cells, mesh.cell_type)
    body = scene(stirred, material, 1e3, 0.3, gravity=STILL)
    return replace(body, pinned=~free)


def equilibrium(body: Scene, start: Array, method: str = "newton", linear_solver: str = "direct") -> Array:
    """The equilibrium reached from a displacement whose pinned vertices are where they shall be, (n, 3)."""
    stepper = FullStepper(
        body, FullOptions(tolerance=1e-9, method=method, linear_solver=linear_solver, quasistatic=True)
    )
    there = [np.hstack([np.eye(3), offset[:, None]]) for offset in start[body.pinned]]
    pins = tuple(map(MovedPins, np.flatnonzero(body.pinned)[:, None], there))
    state, solution = stepper.step(FullState(start, start, start), Loads(pins=pins))
    assert solution.converged, solution.reason.words
    return state.u


@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.parametrize("cell_type", ["tet4", "hex8"])
def test_a_distorted_mesh_whose_surface_moves_affinely_follows_everywhere(cell_type: str, material: str) -> None:
    body = clamped_box(3, cell_type, material, noise=0.25)
    affine = body.mesh.vertices @ np.array([[0.1, 0.06, -0.03], [-0.05, -0.04, 0.08], [0.02, 0.07, 0.05]])
    start = np.where(body.pinned[:, None], affine, 0.0)
    assert np.abs(start - affine).max() > 0.05
    np.testing.assert_allclose(equilibrium(body, start), affine, rtol=0, atol=1e-10)


@pytest.mark.parametrize(("method", "linear_solver"), SOLVERS)
def test_every_solver_passes_the_patch_test(method: str, linear_solver: str) -> None:
    body = clamped_box(4, "hex8", "neo_hookean", noise=0.2)
    affine = body.mesh.vertices @ np.array([[0.1, 0.06, -0.03], [-0.05, -0.04, 0.08], [0.02, 0.07, 0.05]])
    start = np.where(body.pinned[:, None], affine, 0.0)
    np.testing.assert_allclose(equilibrium(body, start, method, linear_solver), affine, rtol=0, atol=1e-10)


def manufactured(x: Array) -> tuple[Array, Array]:
    """A smooth displacement (3,) and its gradient (3, 3) at a point of the unit cube."""
    a, b, c = x * [2.0, 1.5, 1.0] + [0.3, 0.2, 0.1]
    u = 0.08 * np.array([np.sin(a) * np.cos(b), np.sin(b + c), np.cos(a) * np.sin(c)])
    gradient = 0.08 * np.array(
        [
            [2.0 * np.cos(a) * np.cos(b), -1.5 * np.sin(a) * np.sin(b), 0.0],
            [0.0, 1.5 * np.cos(b + c), np.cos(b + c)],
            [-2.0 * np.sin(a) * np.sin(c), 0.0, np.cos(a) * np.cos(c)],
        ]
    )
    return u, gradient


def body_force(body: Scene, x: Array) -> Array:
    """−Div P of the manufactured displacement at a point, N/m³, by central differences."""
    kind, mu, lam = body.elements.kind[0], body.mu[0], body.lam[0]

    def stress(point: Array) -> Array:
        F = np.eye(3) + manufactured(point)[1]
        return np.array(energy_stress(kind, tuple(F.ravel().tolist()), mu, lam)[1]).reshape(3, 3)

    step = 1e-4
    return -sum((stress(x + step * e) - stress(x - step * e)) @ e / (2 * step) for e in np.eye(3))


def l2_error(body: Scene, u: Array) -> float:
    """‖u_h − u‖ in L², by a rule of degree two or more in every cell."""
    mesh = body.mesh
    shape = TET_RULE if mesh.cell_type == "tet4" else reference_points(mesh.cell_type)[0]
    weights = np.repeat(body.points.weights / 4, 4) if mesh.cell_type == "tet4" else body.points.weights
    points, values = (np.einsum("pa,mai->mpi", shape, f[mesh.cells]).reshape(-1, 3) for f in (mesh.vertices, u))
    exact = np.array([manufactured(x)[0] for x in points])
    return float(np.sqrt(weights @ ((values - exact) ** 2).sum(axis=1)))


def manufactured_error(cells: int, cell_type: str, material: str) -> float:
    body = clamped_box(cells, cell_type, material, noise=0.0)
    exact = np.array([manufactured(x)[0] for x in body.mesh.vertices])
    force = body.mass @ np.array([body_force(body, x) for x in body.mesh.vertices]) / body.density[0]
    body = replace(body, load=force)
    return l2_error(body, equilibrium(body, np.where(body.pinned[:, None], exact, 0.9 * exact)))


@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.parametrize("cell_type", ["tet4", "hex8"])
def test_the_error_against_a_manufactured_solution_falls_with_the_square_of_the_cell(
    cell_type: str, material: str
) -> None:
    cells = np.array([4, 8])
    errors = [manufactured_error(int(m), cell_type, material) for m in cells]
    assert 1.9 <= order(errors, 1 / cells) <= 2.3


def end_of_swing(steps: int, body: Scene) -> Array:
    """Where a solid that begins to hang at rest is after 0.16 s in a number of steps."""
    body = replace(body, time_step=0.16 / steps)
    stepper = FullStepper(body, FullOptions(tolerance=1e-7))
    state = stepper.rest()
    for _ in range(steps):
        state, solution = stepper.step(state, Loads())
        assert solution.converged
    return state.u


def test_the_error_of_a_swing_falls_with_the_time_step() -> None:
    body = scene(beam(0.4, 0.1, 0.1, 1), "neo_hookean")
    ends = [end_of_swing(steps, body) for steps in (40, 80, 160)]
    first, second = np.linalg.norm(ends[0] - ends[1]), np.linalg.norm(ends[1] - ends[2])
    assert 0.9 <= np.log2(first / second) <= 1.1


@pytest.mark.parametrize("material", [name for name in MATERIALS if name != "linear"])
def test_a_free_spinning_solid_keeps_its_momentum_and_loses_spin_only_as_implicit_euler_does(material: str) -> None:
    # x_{n+1} × M (v_{n+1} − v_n) = 0 and x_{n+1} = x_n + h v_{n+1} give L_{n+1} = L_n + h Σ v_{n+1} × M v_n.
    body = scene(beam(0.4, 0.1, 0.1, 1), material, 2e4, gravity=STILL)
    body.pinned[:] = False
    x, h = body.mesh.vertices, body.time_step
    stepper = FullStepper(body, FullOptions(tolerance=1e-10))
    velocity = np.cross([1.0, 3.0, -2.0], x - x.mean(axis=0)) + [0.2, -0.1, 0.3]
    state = replace(stepper.rest(), u_previous=-h * velocity)
    spins = []
    for _ in range(10):
        state, solution = stepper.step(state, Loads())
        assert solution.converged
        momentum, before = body.mass @ (state.u - state.u_previous) / h, body.mass @ velocity
        np.testing.assert_allclose(momentum.sum(axis=0), before.sum(axis=0), rtol=1e-7)
        spin, old = (np.cross(x + u, p).sum(axis=0) for u, p in ((state.u, momentum), (state.u_previous, before)))
        lost = h * np.cross((state.u - state.u_previous) / h, before).sum(axis=0)
        np.testing.assert_allclose(spin, old + lost, atol=1e-9)
        velocity = (state.u - state.u_previous) / h
        centre = ((x + state.u) * body.mass.sum(axis=1)[:, None]).sum(axis=0) / body.mass.sum()
        spins.append(np.linalg.norm(np.cross(x + state.u - centre, momentum).sum(axis=0)))
    assert (np.diff(spins) < 0).all()
    assert spins[-1] > 0.9 * spins[0]
