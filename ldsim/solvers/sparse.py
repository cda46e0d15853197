"""Direct factorisation of sparse symmetric positive definite matrices: nested dissection and SuperLU.

METIS' ordering makes SciPy's SuperLU 2.5 times faster at 65k degrees of freedom (shared/reference/dependencies.md).
"""

from __future__ import annotations

import numpy as np
import pymetis
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array
from scipy.sparse.linalg import splu

from ldsim.errors import SolverError


def nested_dissection(graph: csr_array) -> NDArray[np.int64]:
    """A fill-reducing order of the nodes of a symmetric graph without diagonal, (f,) int64."""
    if graph.shape[0] < 2 or graph.nnz == 0:
        return np.arange(graph.shape[0], dtype=np.int64)
    adjacency = pymetis.CSRAdjacency(graph.indptr, graph.indices)
    order, _ = pymetis.nested_dissection(adjacency)
    return np.asarray(order, dtype=np.int64)


class Factor:
    """The factor of a symmetric positive definite matrix whose order already reduces fill.

    Raises:
        SolverError: the matrix is singular, or its factor does not fit in memory.
    """

    def __init__(self, matrix: csc_array) -> None:
        try:
            self._lu = splu(
                matrix, permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True, "Equil": False}
            )
        except RuntimeError as error:
            raise SolverError(
                f"the system matrix of {matrix.shape[0]} unknowns cannot be factorised ({error}); "
                "check that every part of the solid is pinned or the time step is positive"
            ) from error
        except MemoryError as error:
            raise SolverError(f"the factor of {matrix.shape[0]} unknowns does not fit in memory") from error

    def solve(self, right: NDArray[np.float64]) -> NDArray[np.float64]:
        """x with A x = right, for (f,) or (f, columns) float64."""
        solution: NDArray[np.float64] = self._lu.solve(right)
        return solution
