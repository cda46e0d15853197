"""The sparse factor against dense solves."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array

from ldsim.errors import SolverError
from ldsim.solvers.sparse import Factor, nested_dissection


def laplacian(side: int) -> NDArray[np.float64]:
    """The five-point Laplacian of a square grid, plus the identity."""
    line = 2 * np.eye(side) - np.eye(side, k=1) - np.eye(side, k=-1)
    return np.kron(line, np.eye(side)) + np.kron(np.eye(side), line) + np.eye(side * side)


def graph_of(matrix: NDArray[np.float64]) -> csr_array:
    return csr_array((matrix - np.diag(np.diag(matrix)) != 0).astype(np.int8))


def test_the_factor_solves_as_a_dense_solver_does_for_one_and_several_right_sides() -> None:
    A, rng = laplacian(9), np.random.default_rng(0)
    factor = Factor(csc_array(A))
    for shape in ((81,), (81, 4)):
        b = rng.normal(size=shape)
        np.testing.assert_allclose(factor.solve(b), np.linalg.solve(A, b), atol=1e-12)


def test_a_singular_matrix_is_refused() -> None:
    with pytest.raises(SolverError, match="system matrix of 3 unknowns cannot be factorised"):
        Factor(csc_array(np.diag([1.0, 0.0, 2.0])))


@pytest.mark.parametrize("side", [1, 2, 12])
def test_nested_dissection_orders_every_node_once(side: int) -> None:
    order = nested_dissection(graph_of(laplacian(side)))
    np.testing.assert_array_equal(np.sort(order), np.arange(side * side))


def test_nodes_without_neighbours_can_be_ordered() -> None:
    np.testing.assert_array_equal(np.sort(nested_dissection(csr_array((4, 4), dtype=np.int8))), range(4))


def test_nested_dissection_fills_less_than_the_order_of_the_grid() -> None:
    A = laplacian(30)
    order = nested_dissection(graph_of(A))

    def fill(matrix: NDArray[np.float64]) -> int:
        return int((np.abs(np.linalg.cholesky(matrix)) > 1e-14).sum())

    assert fill(A[np.ix_(order, order)]) < 0.6 * fill(A)
