"""The sparse factor and its structure against dense solves."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ldsim.errors import SolverError
from ldsim.optimise.elimination import eliminate, elimination_order, nested_dissection
from ldsim.optimise.sparse import Factor

Array = NDArray[np.float64]
BLOCK = np.array([[4.0, 1.0, 0.0], [1.0, 3.0, -1.0], [0.0, -1.0, 5.0]])


def laplacian(side: int) -> Array:
    """The five-point Laplacian of a square grid, plus the identity."""
    line = 2 * np.eye(side) - np.eye(side, k=1) - np.eye(side, k=-1)
    return np.kron(line, np.eye(side)) + np.kron(np.eye(side), line) + np.eye(side * side)


def graph_of(matrix: Array) -> csr_array:
    return csr_array((matrix - np.diag(np.diag(matrix)) != 0).astype(np.int8))


def system(pattern: Array, seed: int = 0) -> tuple[Array, Array, NDArray[np.int64], NDArray[np.int64]]:
    """A random positive definite matrix of 3×3 blocks with the given pattern, dense, and its blocks in order."""
    rng, n = np.random.default_rng(seed), len(pattern)
    noise = rng.normal(size=(3 * n, 3 * n)) * np.kron(pattern != 0, np.ones((3, 3)))
    A = noise + noise.T
    A += np.diag(np.abs(A).sum(axis=1) + 0.1)
    rows, columns = np.nonzero(pattern)
    blocks = A.reshape(n, 3, n, 3).transpose(0, 2, 1, 3)[rows, columns]
    return A, blocks, np.searchsorted(rows, np.arange(n + 1)), columns.astype(np.int64)


def patterns() -> dict[str, Array]:
    """Patterns in elimination order: a grid, a path, a dense block, parts that do not touch, an arrow, one node."""
    arrow = np.eye(6)
    arrow[-1], arrow[:, -1] = 1, 1
    shapes = {
        "grid": laplacian(9),
        "path": np.eye(7) + np.eye(7, k=1) + np.eye(7, k=-1),
        "dense": np.ones((5, 5)),
        "two parts": np.kron(np.eye(2), laplacian(4)),
        "arrow": arrow,
        "one node": np.ones((1, 1)),
        "no neighbours": np.eye(4),
    }
    orders = {name: elimination_order(graph_of(shape)) for name, shape in shapes.items()}
    return {name: shape[np.ix_(orders[name], orders[name])] for name, shape in shapes.items()}


@pytest.mark.parametrize("pattern", patterns().values(), ids=patterns().keys())
def test_the_factor_solves_as_a_dense_solver_does(pattern: Array) -> None:
    A, blocks, indptr, indices = system(pattern)
    b = np.random.default_rng(1).normal(size=len(A))
    x = Factor(eliminate(indptr, indices), indptr, indices, blocks).solve(b)
    np.testing.assert_allclose(x, np.linalg.solve(A, b), rtol=0, atol=1e-13 * np.abs(b).max())


def test_a_factor_in_single_precision_solves_to_single_precision() -> None:
    A, blocks, indptr, indices = system(patterns()["grid"])
    b = np.random.default_rng(1).normal(size=len(A))
    error = Factor(eliminate(indptr, indices), indptr, indices, blocks, single=True).solve(b) - np.linalg.solve(A, b)
    assert 1e-10 < np.abs(error).max() < 1e-6 * np.abs(b).max()


def test_what_single_precision_cannot_hold_is_factorised_in_double() -> None:
    # [[1, 1], [1, 1 + 1e-10]] in every axis: the second pivot is below the rounding of float32
    A = np.kron(np.array([[1.0, 1.0], [1.0, 1.0 + 1e-10]]), np.eye(3))
    blocks = A.reshape(2, 3, 2, 3).transpose(0, 2, 1, 3).reshape(4, 3, 3)
    indptr, indices = np.array([0, 2, 4]), np.array([0, 1, 0, 1])
    x = Factor(eliminate(indptr, indices), indptr, indices, blocks, single=True).solve(A @ np.arange(6.0))
    np.testing.assert_allclose(x, np.arange(6.0), atol=1e-4)


@pytest.mark.parametrize("single", [False, True])
def test_a_matrix_that_is_not_positive_definite_is_refused(single: bool) -> None:
    blocks = np.array([np.diag([1.0, 2.0, -1.0])])
    indptr, indices = np.array([0, 1]), np.array([0])
    with pytest.raises(SolverError, match="system matrix of 3 unknowns cannot be factorised .pivot 3"):
        Factor(eliminate(indptr, indices), indptr, indices, blocks, single)


@pytest.mark.parametrize("name", patterns())
def test_the_structure_holds_every_entry_of_the_dense_factor(name: str) -> None:
    A, _, indptr, indices = system(patterns()[name])
    e = eliminate(indptr, indices)
    L = np.linalg.cholesky(A)[::3, ::3]
    held = np.zeros_like(L, dtype=bool)
    for s in range(len(e.parent)):
        columns = np.arange(e.first[s], e.first[s + 1])
        held[np.ix_(np.concatenate([columns, e.rows[e.row_start[s] : e.row_start[s + 1]]]), columns)] = True
    assert held[np.abs(L) > 1e-14].all()
    assert e.entries == 9 * held.sum()


@pytest.mark.parametrize("side", [1, 2, 12])
def test_both_orders_take_every_node_once(side: int) -> None:
    for ordered in (nested_dissection, elimination_order):
        np.testing.assert_array_equal(np.sort(ordered(graph_of(laplacian(side)))), np.arange(side * side))


def test_nodes_without_neighbours_can_be_ordered() -> None:
    np.testing.assert_array_equal(np.sort(nested_dissection(csr_array((4, 4), dtype=np.int8))), range(4))


def test_the_elimination_order_fills_less_than_the_order_of_the_grid() -> None:
    A = laplacian(30)
    order = elimination_order(graph_of(A))

    def fill(matrix: Array) -> int:
        return int((np.abs(np.linalg.cholesky(matrix)) > 1e-14).sum())

    assert fill(A[np.ix_(order, order)]) < 0.6 * fill(A)
