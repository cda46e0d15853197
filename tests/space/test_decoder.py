"""Decoders: exact rest, derivatives and the adjoint identity, for every activation and shape of network."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ldsim.space.activation import ACTIVATIONS, elu
from ldsim.space.decoder import Decoder
from ldsim.space.encoder import Encoder, nearest_latent
from tests.helpers import derivative_order

Array = NDArray[np.float64]


def network(activation: str, hidden: tuple[int, ...], skip: bool, seed: int = 0) -> Decoder:
    """A random decoder from R^3 to R^7."""
    rng = np.random.default_rng(seed)
    sizes = [3, *hidden, 7]
    weights = [rng.normal(size=(a, b)) / np.sqrt(a) for a, b in zip(sizes[:-1], sizes[1:], strict=True)]
    biases = [rng.normal(size=b) for b in sizes[1:]]
    return Decoder.network(weights, biases, activation, rng.normal(size=(3, 7)) if skip else None)


def decoders() -> list[object]:
    cases = [
        pytest.param(network(activation, hidden, skip), id=f"{activation}-{hidden}-{'skip' if skip else 'plain'}")
        for activation in ACTIVATIONS
        for hidden in ((), (5,), (6, 4), (5, 8, 5))
        for skip in (False, True)
    ]
    return [*cases, pytest.param(Decoder.identity(4), id="identity")]


@pytest.mark.parametrize("decoder", decoders())
def test_rest_decodes_to_rest_to_the_last_bit(decoder: Decoder) -> None:
    assert not decoder(np.zeros(decoder.r)).any()


@pytest.mark.parametrize("decoder", decoders())
def test_the_jacobian_is_the_derivative(decoder: Decoder) -> None:
    rng = np.random.default_rng(1)
    z, d = rng.normal(size=decoder.r), rng.normal(size=decoder.r)
    assert derivative_order(decoder, lambda x: decoder.jacobian(x) @ d, z, d, size=0.1) > 1.9


@pytest.mark.parametrize("decoder", decoders())
def test_the_vjp_is_the_adjoint_of_the_jacobian(decoder: Decoder) -> None:
    rng = np.random.default_rng(2)
    z, d, v = rng.normal(size=decoder.r), rng.normal(size=decoder.r), rng.normal(size=decoder.k)
    assert v @ (decoder.jacobian(z) @ d) == pytest.approx(decoder.vjp(z, v) @ d, rel=1e-12)


@pytest.mark.parametrize("decoder", decoders())
def test_a_batch_is_decoded_row_by_row(decoder: Decoder) -> None:
    z = np.random.default_rng(3).normal(size=(5, decoder.r))
    np.testing.assert_array_equal(decoder(z), [decoder(row) for row in z])


def test_weights_and_biases_come_back_as_they_were_given() -> None:
    decoder = network("elu", (6, 4), skip=False)
    again = Decoder.network(decoder.weights, decoder.biases)
    z = np.random.default_rng(4).normal(size=3)
    np.testing.assert_array_equal(again(z), decoder(z))
    assert [w.shape for w in decoder.weights] == [(3, 6), (6, 4), (4, 7)]


def test_the_network_agrees_with_plain_matrix_algebra() -> None:
    decoder = network("elu", (6, 4), skip=False)
    perceptron = Encoder(tuple(decoder.weights), tuple(decoder.biases))
    z = np.random.default_rng(5).normal(size=(4, 3))
    np.testing.assert_allclose(decoder(z), perceptron(z), rtol=1e-12, atol=1e-14)


def test_the_exponential_unit_is_exact_to_rounding_at_every_size() -> None:
    sizes = 10.0 ** np.linspace(-300, 3, 2000)
    x = np.concatenate([-sizes, sizes, [0.0, -0.0, -np.inf, np.inf, np.nan], np.linspace(-5, 5, 1001)])
    y = x.copy()
    elu(y)
    expected = np.where(x > 0, x, np.expm1(np.minimum(x, 0)))
    np.testing.assert_allclose(y, expected, rtol=4e-16, atol=1e-300)


def test_the_nearest_latent_state_of_a_decoded_one_is_found() -> None:
    decoder = network("elu", (6, 4), skip=True)
    z = np.random.default_rng(6).normal(size=3)
    found = nearest_latent(decoder, decoder(z), z + 0.1, iterations=60)
    np.testing.assert_allclose(decoder(found), decoder(z), atol=1e-8)


def test_the_nearest_latent_state_has_no_gradient() -> None:
    decoder = network("tanh", (6, 4), skip=True)
    q = np.random.default_rng(7).normal(size=7)
    z = nearest_latent(decoder, q, np.zeros(3), iterations=200)
    assert np.linalg.norm(decoder.vjp(z, decoder(z) - q)) < 1e-4 * np.linalg.norm(q)


def test_a_skip_that_is_not_transposed_is_refused() -> None:
    decoder = network("elu", (6, 4), skip=False)
    with pytest.raises(ValueError, match=r"expected \(r, k\) = \(3, 7\)"):
        Decoder.network(decoder.weights, decoder.biases, "elu", np.eye(7)[:, :3])
