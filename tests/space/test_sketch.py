"""Modes by random projection: those of the method of snapshots, where the singular values fall as a solid's do."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from ldsim.errors import SolverError
from ldsim.space.pca import leading_modes
from ldsim.space.sketch import sketched_modes
from tests.space.test_relaxation import beam

BODY = beam()
SIZE = 3 * BODY.mesh.n_vertices


def rows(count: int, rank: int, fall: float = 0.7) -> NDArray[np.float32]:
    """Random rows whose singular values fall by a factor each."""
    rng = np.random.default_rng(1)
    left, right = np.linalg.qr(rng.normal(size=(count, rank)))[0], np.linalg.qr(rng.normal(size=(SIZE, rank)))[0]
    return (left * fall ** np.arange(rank) @ right.T).astype(np.float32)


def in_chunks(found: NDArray[np.float32]) -> Iterator[NDArray[np.float32]]:
    yield from np.array_split(found, 5)


def test_it_finds_what_the_method_of_snapshots_finds() -> None:
    given = rows(90, 30)
    found = sketched_modes(lambda: in_chunks(given), BODY.mass, 8)
    expected = leading_modes(lambda: in_chunks(given), BODY.mass, 8)[0]
    np.testing.assert_allclose(found.project(found.matrix.T), np.eye(8), atol=1e-9)
    # the last modes may differ where singular values lie close; what is left out of the rows may not
    left_out = [np.linalg.norm(given - each.project(given) @ each.matrix.T) for each in (found, expected)]
    assert left_out[0] <= 1.001 * left_out[1]
    np.testing.assert_allclose(np.abs(np.diag(found.project(expected.matrix.T)))[:4], 1.0, atol=1e-3)


def test_of_few_independent_rows_it_finds_as_many_modes() -> None:
    given = rows(40, 5)
    assert sketched_modes(lambda: in_chunks(given), BODY.mass, 12).k == 5


@pytest.mark.parametrize("value", [0.0, np.nan])
def test_rows_of_nothing_are_refused(value: float) -> None:
    given = np.full((6, SIZE), value, dtype=np.float32)
    with pytest.raises(SolverError, match="zero, or one is not finite"):
        sketched_modes(lambda: in_chunks(given), BODY.mass, 3)
