"""The compiled step against one that shares nothing with it: NumPy, from the vertices and the formula of the material.

Gradients by complex steps, exact to rounding; the minimum by Newton's method with differences of gradients.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from ldsim.cubature.rule import CubatureRule
from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.mechanics.grabs import Grab
from ldsim.mechanics.loads import Loads
from ldsim.mechanics.properties import lame_parameters
from ldsim.mesh.shapes import beam
from ldsim.space.decoder import Decoder
from tests.helpers import reduced_space, scene, smooth_basis

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

K, R = 6, 3
FRAMES = 12
OPTIONS = ReducedOptions(tolerance=1e-8, max_iterations=500)
MU, LAM = lame_parameters(3e4, 0.4)


def neo_hookean(F: Complex) -> Complex:
    J = np.linalg.det(F)
    assert (J.real > 0).all()
    return MU / 2 * (J ** (-2 / 3) * np.einsum("sij,sij->s", F, F) - 3) + LAM / 2 * (J - 1) ** 2


def st_venant_kirchhoff(F: Complex) -> Complex:
    E = (np.einsum("ski,skj->sij", F, F) - np.eye(3)) / 2
    return MU * np.einsum("sij,sij->s", E, E) + LAM / 2 * np.einsum("sii->s", E) ** 2


def gradient(f: Callable[[Complex], Complex], z: Array) -> Array:
    """By complex steps."""
    h = 1e-30
    return np.array([f(z + 1j * h * e)[()].imag / h for e in np.eye(len(z))])


def minimum(f: Callable[[Complex], Complex], z: Array) -> Array:
    """Newton's method from nearby."""
    for _ in range(30):
        g = gradient(f, z)
        H = np.array([(gradient(f, z + 1e-6 * e) - gradient(f, z - 1e-6 * e)) / 2e-6 for e in np.eye(len(z))])
        d = np.linalg.solve((H + H.T) / 2, -g)
        z = z + d
        if np.linalg.norm(d) <= 1e-13 * max(np.linalg.norm(z), 1):
            break
    return z


@pytest.mark.parametrize("name, density", [("neo_hookean", neo_hookean), ("st_venant_kirchhoff", st_venant_kirchhoff)])
def test_pulled_and_let_go_it_takes_the_steps_of_slow_numpy(name: str, density: Callable[[Complex], Complex]) -> None:
    body = scene(beam(resolution=1), material=name, youngs_modulus=3e4, poisson_ratio=0.4)
    rng = np.random.default_rng(3)
    points = rng.choice(body.points.n_points, 7, replace=False)
    w = rng.uniform(0.5, 2, 7) * body.points.weights.sum() / 7
    U = smooth_basis(body, K)
    W1, W2, b1, A = rng.normal(size=(R, 5)), 0.05 * rng.normal(size=(5, K)), rng.normal(size=5), np.eye(R, K)
    decoder = Decoder.network([W1, W2], [b1, np.zeros(K)], "elu", A)
    compiled = ReducedStepper(reduced_space(body, U, decoder, CubatureRule(points, w, 0.0)), OPTIONS)

    def elu(x: Complex) -> Complex:
        return np.where(x.real > 0, x, np.exp(x) - 1)

    def phi(z: Complex) -> Complex:
        return (elu(z @ W1 + b1) - elu(b1 + 0j)) @ W2 + z @ A

    corners = body.mesh.vertices[body.mesh.cells[points]]
    edges = np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2)
    nodal = U.reshape(-1, 3, K)
    mass = U.T @ np.asarray(body.mass @ nodal.reshape(body.mesh.n_vertices, -1)).reshape(U.shape)
    load = U.T @ body.external_force.ravel()
    tip = np.argsort(body.mesh.vertices[:, 0])[-4:]
    grab = Grab(tip, body.mesh.vertices[tip].mean(axis=0) + [0, 0.03, 0.02], 40.0)

    def potential(z: Complex, predictor: Array, grabs: tuple[Grab, ...]) -> Complex:
        q = phi(z)
        moved = (nodal @ q)[body.mesh.cells[points]]
        deformed = np.swapaxes(moved[:, 1:] - moved[:, :1], 1, 2) + edges
        F = deformed @ np.linalg.inv(edges)
        offset = q - predictor
        value = offset @ mass @ offset / (2 * body.time_step**2) + w @ density(F) - load @ q
        for held in grabs:
            away = (
                (nodal[held.vertices] @ q).mean(axis=0) + body.mesh.vertices[held.vertices].mean(axis=0) - held.target
            )
            value = value + held.stiffness / 2 * away @ away
        return value

    state = compiled.rest()
    z, q, before = np.zeros(R), np.zeros(K), np.zeros(K)
    for frame in range(FRAMES):
        grabs = (grab,) if frame < FRAMES // 2 else ()
        predictor = 2 * q - before
        z = minimum(lambda z, p=predictor, g=grabs: potential(z, p, g), z)
        q, before = phi(z + 0j).real, q
        state, _ = compiled.step(state, Loads(grabs))
        np.testing.assert_allclose(state.z, z, rtol=0, atol=1e-8 * max(np.linalg.norm(z), 1))
    assert np.linalg.norm(z) > 1e-3
