"""The quadratic manifold finds one again that poses lie on, and its slope is that of finite differences."""

from __future__ import annotations

import numpy as np
import pytest

from reproduction.rivals.quadratic_manifold import QuadraticDecoder, chosen, fitted, products

R, K = 3, 7


def test_a_quadratic_is_found_again_where_poses_lie_on_one() -> None:
    rng = np.random.default_rng(0)
    truth = QuadraticDecoder(rng.normal(size=(R * (R + 1) // 2, K - R)), R)
    poses = truth(rng.normal(size=(40, R)))
    np.testing.assert_allclose(fitted(poses, R, 1e-12).weights, truth.weights, atol=1e-8)


def test_the_slope_is_that_of_finite_differences() -> None:
    rng = np.random.default_rng(1)
    decoder = QuadraticDecoder(rng.normal(size=(R * (R + 1) // 2, K - R)), R)
    z, v, step = rng.normal(size=R), rng.normal(size=K), 1e-6
    slope = np.stack([(decoder(z + d) - decoder(z - d)) / (2 * step) for d in step * np.eye(R)], axis=1)
    np.testing.assert_allclose(decoder.jacobian(z), slope, atol=1e-8)
    np.testing.assert_allclose(decoder.vjp(z, v), slope.T @ v, atol=1e-8)


def test_the_ridge_is_the_one_that_serves_the_poses_kept_back() -> None:
    rng = np.random.default_rng(2)
    truth = QuadraticDecoder(rng.normal(size=(R * (R + 1) // 2, K - R)), R)
    few, others = truth(rng.normal(size=(4, R))), truth(rng.normal(size=(30, R)))  # four poses for six products
    few[:, R:] += rng.normal(size=(4, K - R))
    ridges = (1e-9, 1.0, 1e6)
    off = [np.linalg.norm(fitted(few, R, ridge)(others[:, :R]) - others) for ridge in ridges]
    best = fitted(few, R, ridges[int(np.argmin(off))])
    np.testing.assert_array_equal(chosen(few, others, R, ridges).weights, best.weights)


def test_products_are_those_of_two_coordinates() -> None:
    assert products(np.array([2.0, 3.0])) == pytest.approx([4, 6, 9])
