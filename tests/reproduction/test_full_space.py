"""Training modes of Figure 5: outer layers that are trained or frozen, and a loss in the full space."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ldsim.arrays import Array
from ldsim.errors import SolverError
from reproduction.paper.full_space import MODES, train_full_space
from tests.learn.test_modes import SHORT, K, R, swing


def displacements() -> tuple[NDArray[np.float32], Array]:
    """A curved motion of 30 degrees of freedom, and its PCA of six modes."""
    modes = np.linalg.qr(np.random.default_rng(4).normal(size=(30, K)))[0]
    u = swing() @ modes.T
    return u.astype(np.float32), np.ascontiguousarray(np.linalg.svd(u, full_matrices=False)[2][:K].T)


@pytest.mark.parametrize("mode", MODES)
def test_full_space_training_beats_as_many_linear_modes_and_keeps_rest(mode: str) -> None:
    u, U = displacements()
    trained = train_full_space(u, U, R, SHORT.replace(epochs=250), mode)
    np.testing.assert_allclose(trained.U.T @ trained.U, np.eye(K), atol=1e-10)
    decoded = trained.decoder(trained.encoder(u @ trained.U)) @ trained.U.T
    linear = np.square(u - u @ U[:, :R] @ U[:, :R].T).sum(axis=1).mean()
    if mode != "random":
        assert np.square(u - decoded).sum(axis=1).mean() < 0.5 * linear
        assert np.square(u - decoded).sum(axis=1).mean() == pytest.approx(trained.loss[-1], rel=0.3)
    assert trained.loss[-1] < 0.1 * trained.loss[0]
    assert not trained.decoder(np.zeros(R)).any()


def test_frozen_outer_layers_stay_where_the_pca_put_them() -> None:
    u, U = displacements()
    trained = train_full_space(u, U, R, SHORT, "pca_frozen")
    np.testing.assert_allclose(trained.U @ trained.U.T, U @ U.T, atol=1e-6)


def test_an_unknown_mode_is_refused() -> None:
    with pytest.raises(SolverError, match="known are random, pca_trained, pca_frozen"):
        train_full_space(*displacements(), R, SHORT, "pca")
