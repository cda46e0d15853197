"""PCA: orthonormal, optimal, the same however it is streamed, and honest about what it cannot do."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
import pytest
from numpy.typing import NDArray

from ldsim.errors import SettingsError, SolverError
from ldsim.mesh.shapes import beam
from ldsim.options import checked_options
from ldsim.space.basis import inner_product, weighted
from ldsim.space.options import PcaOptions
from ldsim.space.pca import Chunks, errors_against_k, fit_basis, turned
from ldsim.space.projection import matching_dimension
from tests.helpers import scene

Array = NDArray[np.float64]

BODY = scene(beam(resolution=2))
SIZE = BODY.mesh.n_vertices * 3
SMALL = PcaOptions(criterion="max_error", tolerance_mm=1e-6, max_k=2)


def snapshots(rank: int = 12, frames: int = 40, seed: int = 0) -> NDArray[np.float32]:
    rng = np.random.default_rng(seed)
    modes = rng.normal(size=(rank, SIZE)) * 0.7 ** np.arange(rank)[:, None]
    return (rng.normal(size=(frames, rank)) @ modes).astype(np.float32)


def streamed(rows: NDArray[np.float32], size: int) -> Chunks:
    return lambda: (rows[start : start + size] for start in range(0, len(rows), size))


@pytest.mark.parametrize("kind", ["mass", "euclidean"])
def test_the_basis_is_orthonormal_in_its_inner_product(kind: str) -> None:
    metric = inner_product(BODY.mass, kind)
    U = fit_basis(streamed(snapshots(), 40), metric, PcaOptions(k=8)).basis.matrix
    np.testing.assert_allclose(weighted(metric, U.T) @ U, np.eye(8), atol=1e-12)


def test_chunks_of_any_size_give_the_same_basis() -> None:
    metric = inner_product(BODY.mass, "mass")
    whole, pieces = (fit_basis(streamed(snapshots(), size), metric, PcaOptions(k=8)) for size in (40, 7))
    # products of single precision are summed in another order
    np.testing.assert_allclose(pieces.singular_values[:8], whole.singular_values[:8], rtol=1e-5)
    np.testing.assert_allclose(pieces.basis.matrix, whole.basis.matrix, atol=1e-4 * np.abs(whole.basis.matrix).max())


def test_the_euclidean_basis_spans_what_the_singular_value_decomposition_does() -> None:
    rows = snapshots()
    basis = fit_basis(streamed(rows, 16), inner_product(BODY.mass, "euclidean"), PcaOptions(k=6))
    _, values, vt = np.linalg.svd(rows.astype(np.float64), full_matrices=False)
    np.testing.assert_allclose(basis.singular_values[:6], values[:6], rtol=1e-5)
    assert np.linalg.svd(vt[:6] @ basis.basis.matrix)[1].min() == pytest.approx(1, abs=1e-8)


def test_a_turned_basis_is_that_of_recorded_and_synthetic_frames_together() -> None:
    """Its leading columns are the singular vectors of all frames, recorded ones as heavy as the others together."""
    rows, metric = snapshots(), inner_product(BODY.mass, "mass")
    found = fit_basis(streamed(rows, 16), metric, PcaOptions(k=8))
    q = found.basis.project(rows.astype(np.float64))
    synthetic = np.random.default_rng(3).normal(size=(100, 8)) * np.linspace(0.1, 3, 8) * q.std(axis=0).max()
    other = turned(found, q, synthetic, streamed(rows, 16))
    U = other.basis.matrix
    np.testing.assert_allclose(weighted(metric, U.T) @ U, np.eye(8), atol=1e-10)
    assert other.synthetic is not None
    np.testing.assert_allclose(other.synthetic @ U.T, synthetic @ found.basis.matrix.T, atol=1e-5)
    together = np.concatenate([np.sqrt(len(synthetic) / len(q)) * q, synthetic])
    for j in (1, 3, 5):
        left = together - together @ (V := np.linalg.svd(together, full_matrices=False)[2][:j].T) @ V.T
        columns = weighted(metric, found.basis.matrix.T) @ U[:, :j]
        mine = together - together @ columns @ columns.T
        assert np.linalg.norm(mine) == pytest.approx(np.linalg.norm(left), rel=1e-8)
        plain = together.copy()
        plain[:, :j] = 0
        assert np.linalg.norm(mine) < 0.95 * np.linalg.norm(plain)
    np.testing.assert_allclose(other.max_error[[0, -1]], found.max_error[[0, -1]], rtol=1e-6)
    np.testing.assert_allclose(other.max_error, errors_against_k(streamed(rows, 16), other.basis)[0])


def test_errors_against_k_are_those_of_the_projections() -> None:
    rows, metric = snapshots(), inner_product(BODY.mass, "mass")
    basis = fit_basis(streamed(rows, 16), metric, PcaOptions(k=8)).basis
    U = basis.matrix
    largest, mean = errors_against_k(streamed(rows, 16), basis)
    for k in (0, 3, 8):
        projected = weighted(metric, rows) @ U[:, :k] @ U[:, :k].T
        distance = np.linalg.norm((rows - projected).reshape(len(rows), -1, 3), axis=2)
        assert (largest[k], mean[k]) == pytest.approx((distance.max(), distance.mean()), rel=1e-6)


@pytest.mark.parametrize("criterion", ["max_error", "mean_error"])
def test_a_rule_takes_the_fewest_modes_within_the_tolerance(criterion: Literal["max_error", "mean_error"]) -> None:
    rows, metric = snapshots(), inner_product(BODY.mass, "mass")
    errors = getattr(fit_basis(streamed(rows, 16), metric, PcaOptions(k=12)), criterion)
    options = PcaOptions(criterion=criterion, tolerance_mm=1e3 * 0.5 * (errors[5] + errors[6]), max_k=40)
    assert fit_basis(streamed(rows, 16), metric, options).basis.k == 6


def zeros(rows: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.zeros_like(rows)


def spoilt(rows: NDArray[np.float32]) -> NDArray[np.float32]:
    rows = rows.copy()
    rows[17, 4] = np.nan
    return rows


@pytest.mark.parametrize(
    ("change", "k", "message"),
    [
        (lambda rows: rows, 41, "k = 41 but there are only 40 training snapshots"),
        (lambda rows: rows, 20, "k = 20 but only 12 of 40 training snapshots are independent"),
        (zeros, 3, "all training snapshots are zero"),
        (spoilt, 3, "training snapshot 17 holds a displacement that is not finite"),
        (lambda rows: rows[:0], 3, "there are no training snapshots"),
    ],
)
def test_what_cannot_be_done_is_said_in_one_line(
    change: Callable[[NDArray[np.float32]], NDArray[np.float32]], k: int, message: str
) -> None:
    rows = change(snapshots())
    with pytest.raises(SolverError, match=message) as error:
        fit_basis(streamed(rows, 16), inner_product(BODY.mass, "mass"), PcaOptions(k=k))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(("rank", "k"), [(12, 12), (50, 40)])
def test_left_open_it_has_forty_columns_or_as_many_as_there_are(rank: int, k: int) -> None:
    rows = snapshots(frames=60) if rank == 12 else np.eye(60, SIZE, dtype=np.float32)[:rank]
    assert fit_basis(streamed(rows, 16), inner_product(BODY.mass, "mass"), PcaOptions()).basis.k == k


@pytest.mark.parametrize("given", [{"tolerance_mm": 2.0}, {"energy": 0.1}, {"max_k": 7}], ids=str)
def test_a_tolerance_without_a_criterion_is_refused(given: dict[str, float]) -> None:
    with pytest.raises(SettingsError, match=f"{next(iter(given))} is of a criterion; give criterion too"):
        checked_options(given, "options", PcaOptions)
    for more in ({"criterion": "energy"}, {"k": 3}):
        assert PcaOptions.model_validate(given | more).columns == more.get("k")


def test_too_small_a_limit_for_the_rule_names_the_error_reached() -> None:
    with pytest.raises(SolverError, match="2 modes leave a vertex error of"):
        fit_basis(streamed(snapshots(), 16), inner_product(BODY.mass, "mass"), SMALL)


def test_the_energy_rule_loses_no_more_than_it_may_and_needs_every_mode() -> None:
    rows, metric = snapshots(), inner_product(BODY.mass, "mass")
    basis = fit_basis(streamed(rows, 16), metric, PcaOptions(criterion="energy", energy=1e-2, max_k=40)).basis
    U = basis.matrix

    def lost(k: int) -> float:
        rest = rows - weighted(metric, rows) @ U[:, :k] @ U[:, :k].T
        squares = [float((weighted(metric, field) * field).sum()) for field in (rest, rows)]
        return squares[0] / squares[1]

    assert lost(basis.k) <= 1e-2 < lost(basis.k - 1)


@pytest.mark.parametrize("size", [40, 7])
def test_single_precision_products_give_the_same_basis_as_an_in_memory_decomposition(size: int) -> None:
    rows, metric = snapshots(), inner_product(BODY.mass, "mass")
    root = np.kron(np.linalg.cholesky(metric.toarray()).T, np.eye(3))
    _, values, vt = np.linalg.svd(rows.astype(np.float64) @ root.T, full_matrices=False)
    basis = fit_basis(streamed(rows, size), metric, PcaOptions(k=5))
    np.testing.assert_allclose(basis.singular_values[:5], values[:5], rtol=1e-5)
    assert np.linalg.svd(vt[:5] @ root @ basis.basis.matrix)[1].min() == pytest.approx(1, abs=1e-6)


def test_modes_below_the_rounding_of_single_precision_are_found_too() -> None:
    rng, metric = np.random.default_rng(3), inner_product(BODY.mass, "euclidean")
    modes = np.linalg.qr(rng.normal(size=(SIZE, 4)))[0].T * np.array([1.0, 1e-1, 1e-4, 3e-5])[:, None]
    rows = (np.linalg.qr(rng.normal(size=(40, 4)))[0] @ modes).astype(np.float32)
    basis = fit_basis(streamed(rows, 16), metric, PcaOptions(k=4))
    np.testing.assert_allclose(basis.singular_values[:4], [1.0, 1e-1, 1e-4, 3e-5], rtol=1e-3)


def test_snapshots_that_are_all_the_same_have_one_mode_and_no_second() -> None:
    rows, metric = np.repeat(snapshots()[:1], 30, axis=0), inner_product(BODY.mass, "mass")
    assert fit_basis(streamed(rows, 16), metric, PcaOptions(k=1)).max_error[-1] < 1e-6
    with pytest.raises(SolverError, match="k = 2 but only 1 of 30 training snapshots are independent"):
        fit_basis(streamed(rows, 16), metric, PcaOptions(k=2))


@pytest.mark.parametrize(("target", "dimension"), [(100.0, 1), (4.9, 1), (2.9, 2), (2.4, 3), (0.0, 4)])
def test_the_matching_dimension_is_the_one_with_the_nearest_error_and_at_least_one(
    target: float, dimension: int
) -> None:
    assert matching_dimension(np.array([9.0, 5.0, 3.0, 2.0, 1.0]), target) == dimension
