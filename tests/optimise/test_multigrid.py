"""Multigrid against dense solves, and the modes that it must know."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ldsim.mechanics.scene import Scene
from ldsim.mechanics.stiffness import StiffnessPattern
from ldsim.mesh.shapes import beam
from ldsim.optimise.multigrid import EXACT, LOOSE, Multigrid, rigid_modes
from tests.helpers import bent, scene

Array = NDArray[np.float64]


def system(body: Scene, u: Array) -> tuple[StiffnessPattern, Array, Array]:
    """The pattern, the blocks of M/h² + K(u), and the positions of the free vertices."""
    pattern = StiffnessPattern(body.points.nodes, body.free, body.mesh.n_vertices)
    blocks = pattern.stiffness_blocks(body.elements, u, clamp=True)
    blocks[:, range(3), range(3)] += (pattern.blocks_of(body.mass) / body.time_step**2)[:, None]
    return pattern, blocks, (body.mesh.vertices + u)[pattern.order]


@pytest.mark.parametrize(("exact", "residual"), [(True, EXACT), (False, LOOSE)])
def test_the_residual_is_as_small_as_was_asked(exact: bool, residual: float) -> None:
    body = scene(beam(0.4, 0.1, 0.1, 5), "neo_hookean")
    pattern, blocks, positions = system(body, bent(body.mesh, noise=0.0))
    b = np.random.default_rng(0).normal(size=3 * pattern.n_free)
    x = Multigrid(pattern.indptr, pattern.columns, blocks, positions, exact).solve(b)
    left = np.linalg.norm(pattern.matrix(blocks) @ x - b) / np.linalg.norm(b)
    assert left <= 3 * residual


def test_two_of_them_are_alike_to_the_last_bit_and_leave_the_global_generator_alone() -> None:
    body = scene(beam(0.4, 0.1, 0.1, 3))
    pattern, blocks, positions = system(body, np.zeros_like(body.mesh.vertices))
    b = np.random.default_rng(0).normal(size=3 * pattern.n_free)
    np.random.seed(5)
    first = Multigrid(pattern.indptr, pattern.columns, blocks, positions).solve(b)
    drawn = np.random.rand()
    second = Multigrid(pattern.indptr, pattern.columns, blocks, positions).solve(b)
    np.testing.assert_array_equal(first, second)
    np.random.seed(5)
    assert drawn == np.random.rand()


def test_rigid_modes_cost_no_energy_and_are_independent() -> None:
    body = scene(beam(0.4, 0.1, 0.1, 2), "linear")
    pattern = StiffnessPattern(body.points.nodes, np.arange(body.mesh.n_vertices), body.mesh.n_vertices)
    K = pattern.matrix(pattern.stiffness_blocks(body.elements, np.zeros_like(body.mesh.vertices), clamp=False))
    modes = rigid_modes(body.mesh.vertices)
    assert np.abs(K @ modes).max() < 1e-10 * np.abs(K.toarray()).max()
    assert np.linalg.matrix_rank(modes) == 6
