"""Every material that is listed, against its formula in plain NumPy and against what any elastic solid must satisfy."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from ldsim.errors import SceneError
from ldsim.mechanics.materials import MATERIALS, material_names, material_number
from ldsim.mechanics.materials.kernels import energy, energy_stress, tangent, weighted_stresses
from tests.helpers import STEPS, derivative_order, order, random_rotation
from tests.mechanics import material_vectors

Array = NDArray[np.float64]
MU, LAM = 1.3, 2.1
I = np.eye(3)
NOT_ROTATABLE = {"linear"}  # small strains only: not frame indifferent


def neo_hookean(F: Array) -> float:
    J = np.linalg.det(F)
    return MU / 2 * (J ** (-2 / 3) * np.trace(F.T @ F) - 3) + LAM / 2 * (J - 1) ** 2


def stable_neo_hookean(F: Array) -> float:
    m, l = 4 / 3 * MU, LAM + 5 / 6 * MU
    alpha = 1 + 3 * m / (4 * l)

    def formula(F: Array) -> float:
        I1 = np.trace(F.T @ F)
        return m / 2 * (I1 - 3) + l / 2 * (np.linalg.det(F) - alpha) ** 2 - m / 2 * np.log(I1 + 1)

    return formula(F) - formula(I)


def st_venant_kirchhoff(F: Array) -> float:
    E = (F.T @ F - I) / 2
    return MU * np.sum(E * E) + LAM / 2 * np.trace(E) ** 2


def fixed_corotated(F: Array) -> float:
    stretches = np.linalg.svd(F, compute_uv=False)
    stretches[2] *= np.sign(np.linalg.det(F))
    return MU * np.sum((stretches - 1) ** 2) + LAM / 2 * (np.linalg.det(F) - 1) ** 2


def linear(F: Array) -> float:
    strain = (F + F.T) / 2 - I
    return MU * np.sum(strain**2) + LAM / 2 * np.trace(strain) ** 2


FORMULAS = {f.__name__: f for f in (neo_hookean, stable_neo_hookean, st_venant_kirchhoff, fixed_corotated, linear)}
# λ of the linear solid that a material tends to; the isochoric neo-Hookean's λ is its bulk modulus.
SMALL_STRAIN_LAM = dict.fromkeys(MATERIALS, LAM) | {"neo_hookean": LAM - 2 / 3 * MU}


def strained(seed: int) -> Array:
    """A rotated deformation gradient with stretches between 0.6 and 1.6, none alike."""
    rng = np.random.default_rng(seed)
    return random_rotation(rng) @ np.diag([1.6, 1.1, 0.6] + 0.05 * rng.normal(size=3)) @ random_rotation(rng)


def psi(name: str, F: Array) -> float:
    return float(energy(MATERIALS[name], tuple(F.ravel()), MU, LAM))


def stress(name: str, F: Array) -> Array:
    return np.array(energy_stress(MATERIALS[name], tuple(F.ravel()), MU, LAM)[1]).reshape(3, 3)


def tangent_matrix(name: str, F: Array, clamp: bool = False) -> Array:
    """∂P/∂F as a (9, 9) matrix on row-major vectors, from the sparse form in the frame of the singular vectors."""
    U, V, D, O = tangent(MATERIALS[name], tuple(F.ravel()), MU, LAM, clamp)
    C = np.zeros((3, 3, 3, 3))
    for i in range(3):
        C[i, i, i, i] = D[i]
    for n, (i, j) in enumerate([(0, 1), (0, 2), (1, 2)]):
        C[i, i, j, j] = C[j, j, i, i] = D[3 + n]
        C[i, j, i, j] = C[j, i, j, i] = O[n]
        C[i, j, j, i] = C[j, i, i, j] = O[3 + n]
    frame = np.kron(np.reshape(U, (3, 3)), np.reshape(V, (3, 3)))
    return frame @ C.reshape(9, 9) @ frame.T


@pytest.fixture(params=MATERIALS)
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.mark.parametrize("seed", range(5))
def test_the_energy_is_that_of_the_formula(name: str, seed: int) -> None:
    F = strained(seed)
    assert psi(name, F) == pytest.approx(FORMULAS[name](F), rel=1e-12)
    assert energy_stress(MATERIALS[name], tuple(F.ravel()), MU, LAM)[0] == pytest.approx(psi(name, F), rel=1e-14)


@pytest.mark.parametrize("mu, lam", [(1.0, 0.0), (3e4, 1e5), (1e9, 1e11)])
def test_rest_costs_nothing_and_is_free_of_stress(name: str, mu: float, lam: float) -> None:
    density, P = energy_stress(MATERIALS[name], tuple(I.ravel()), mu, lam)
    assert abs(density) <= 1e-12 * (mu + lam)
    assert np.abs(P).max() <= 1e-12 * (mu + lam)
    assert abs(energy(MATERIALS[name], tuple(I.ravel()), mu, lam)) <= 1e-12 * (mu + lam)


@pytest.mark.parametrize("name", sorted(MATERIALS.keys() - NOT_ROTATABLE))
@pytest.mark.parametrize("seed", range(3))
def test_a_rotation_before_or_after_changes_no_energy_and_turns_the_stress(name: str, seed: int) -> None:
    F, Q = strained(seed), random_rotation(np.random.default_rng(seed + 100))
    assert psi(name, Q @ F) == pytest.approx(psi(name, F), rel=1e-12)
    assert psi(name, F @ Q) == pytest.approx(psi(name, F), rel=1e-12)
    np.testing.assert_allclose(stress(name, Q @ F), Q @ stress(name, F), atol=1e-11)
    np.testing.assert_allclose(stress(name, F @ Q), stress(name, F) @ Q, atol=1e-11)


def test_no_direction_is_preferred(name: str) -> None:
    F, Q = strained(7), random_rotation(np.random.default_rng(8))
    assert psi(name, Q @ F @ Q.T) == pytest.approx(psi(name, F), rel=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_the_stress_is_the_derivative_of_the_energy(name: str, seed: int) -> None:
    F, d = strained(seed), np.random.default_rng(seed).normal(size=(3, 3))
    slope = derivative_order(lambda X: psi(name, X), lambda X: np.sum(stress(name, X) * d), F, d)
    assert slope == pytest.approx(2, abs=0.1)


DEFORMATIONS: dict[str, Callable[[], Array]] = {
    "strained": lambda: strained(3),
    "strained differently": lambda: strained(4),
    "at rest": lambda: I,
    "rotated": lambda: random_rotation(np.random.default_rng(5)),
    "two stretches alike": lambda: np.diag([1.3, 1.3, 0.8]) @ random_rotation(np.random.default_rng(6)),
    "two stretches nearly alike": lambda: np.diag([1.3, 1.3 + 1e-5, 0.8]),
    "dilated": lambda: 1.2 * random_rotation(np.random.default_rng(9)),
}


@pytest.mark.parametrize("F", [make() for make in DEFORMATIONS.values()], ids=DEFORMATIONS.keys())
def test_the_tangent_is_the_derivative_of_the_stress(name: str, F: Array) -> None:
    d = np.random.default_rng(1).normal(size=(3, 3))
    slope = derivative_order(
        lambda X: stress(name, X).ravel(), lambda X: tangent_matrix(name, X) @ d.ravel(), F, d, size=0.1
    )
    assert slope == np.inf if name == "linear" else slope == pytest.approx(2, abs=0.15)


def test_the_tangent_holds_where_the_solid_is_inverted_if_the_energy_does(name: str) -> None:
    F = strained(2) @ np.diag([1, 1, -1])
    if np.isinf(psi(name, F)):
        assert name == "neo_hookean"
        return
    d = np.random.default_rng(1).normal(size=(3, 3))
    assert psi(name, F) == pytest.approx(FORMULAS[name](F), rel=1e-12)
    assert derivative_order(lambda X: psi(name, X), lambda X: np.sum(stress(name, X) * d), F, d) > 1.9
    assert (
        derivative_order(lambda X: stress(name, X).ravel(), lambda X: tangent_matrix(name, X) @ d.ravel(), F, d) > 1.9
    )


@pytest.mark.parametrize("name", ["stable_neo_hookean", "st_venant_kirchhoff"])
@pytest.mark.parametrize("apart", [0.0, 1e-12, 1e-9, 1e-7, 1e-6, 1e-4])
def test_the_tangent_holds_where_two_signed_stretches_are_opposite(name: str, apart: float) -> None:
    rng = np.random.default_rng(12)
    Q, R, d = random_rotation(rng), random_rotation(rng), rng.normal(size=(3, 3))
    F, h = Q @ np.diag([1.2, 0.7, -0.7 - apart]) @ R, 1e-5
    numeric = (stress(name, F + h * d) - stress(name, F - h * d)).ravel() / (2 * h)
    np.testing.assert_allclose(
        tangent_matrix(name, F) @ d.ravel(), numeric, rtol=1e-6, atol=1e-6 * np.abs(numeric).max()
    )


@pytest.mark.parametrize("stretches", [[1.6, 1.1, 0.6], [0.7, 0.5, 0.3], [1.9, 0.4, 0.35]])
def test_clamping_is_the_projection_onto_positive_semidefinite_matrices(name: str, stretches: list[float]) -> None:
    rng = np.random.default_rng(11)
    F = random_rotation(rng) @ np.diag(stretches) @ random_rotation(rng)
    values, vectors = np.linalg.eigh(tangent_matrix(name, F))
    if name not in NOT_ROTATABLE and stretches[0] < 1:
        assert values.min() < -0.01, "compression must make the tangent indefinite, or this shows nothing"
    projected = vectors @ np.diag(np.maximum(values, 0)) @ vectors.T
    np.testing.assert_allclose(tangent_matrix(name, F, clamp=True), projected, atol=1e-12 * values.max())


def test_clamping_leaves_a_tangent_alone_that_is_already_positive(name: str) -> None:
    F = np.diag([1.2, 1.15, 1.1]) if name not in NOT_ROTATABLE else strained(0)
    free = tangent_matrix(name, F)
    assert np.linalg.eigvalsh(free).min() > -1e-12
    np.testing.assert_allclose(tangent_matrix(name, F, clamp=True), free, atol=1e-12)


def test_small_strains_agree_with_linear_elasticity_to_second_order(name: str) -> None:
    G = np.random.default_rng(12).normal(size=(3, 3))
    strain = (G + G.T) / 2
    quadratic = MU * np.sum(strain**2) + SMALL_STRAIN_LAM[name] / 2 * np.trace(strain) ** 2
    gaps = [abs(psi(name, I + h * G) - h * h * quadratic) for h in STEPS]
    if name == "linear":
        assert max(gaps) < 1e-15
    else:
        assert order(gaps, STEPS) == pytest.approx(3, abs=0.1)


@pytest.mark.parametrize("size", [1e-6, 1e-9, 1e-12])
def test_the_papers_neo_hookean_has_an_exact_energy_next_to_rest(size: float) -> None:
    H = size * np.random.default_rng(1).normal(size=(3, 3))
    H = (I + H) - I  # what the sum keeps of it
    strain = (H + H.T) / 2
    linear = MU * (np.sum(strain**2) - np.trace(strain) ** 2 / 3) + LAM / 2 * np.trace(strain) ** 2
    assert psi("neo_hookean", I + H) == pytest.approx(linear, rel=10 * size + 1e-15 / size, abs=0)


def test_only_the_papers_neo_hookean_forbids_inversion() -> None:
    flipped = np.diag([1.0, 1.0, -1.0])
    assert {name for name in MATERIALS if np.isinf(psi(name, flipped))} == {"neo_hookean"}
    assert np.isinf(psi("neo_hookean", np.diag([1.0, 1.0, 0.0])))


def test_the_vectors_that_the_other_implementations_are_held_to_are_of_these_materials(name: str) -> None:
    for case in material_vectors.read()[name]:
        F, dF = (np.reshape(case[key], (3, 3)) for key in ("F", "dF"))
        now = material_vectors.computed(name, F, dF)
        assert now.keys() == case.keys() - {"F", "dF"}
        assert now["density"] == (None if case["density"] is None else pytest.approx(case["density"], abs=1e-9))
        for key in now.keys() - {"density"}:
            np.testing.assert_allclose(now[key], case[key], rtol=1e-10, atol=1e-9 * material_vectors.MU)


@pytest.mark.parametrize("kinds", [[kind] for kind in MATERIALS.values()] + [sorted(MATERIALS.values())])
def test_many_points_at_once_are_the_points_one_by_one(kinds: list[int]) -> None:
    count = 11
    rng = np.random.default_rng(5)
    kind = np.resize(np.array(kinds, dtype=np.int8), count)
    w, mu, lam = rng.uniform(0.5, 2, (3, count))
    F = [strained(seed) for seed in range(count)]
    strain = np.ascontiguousarray(np.array([X - I for X in F]).reshape(count, 9).T)
    total = weighted_stresses(kind, strain, w, mu, lam)
    each = [energy_stress(kind[s], tuple(F[s].ravel()), mu[s], lam[s]) for s in range(count)]
    assert total == pytest.approx(sum(w[s] * each[s][0] for s in range(count)), rel=1e-13)
    expected = np.array([w[s] * np.array(each[s][1]) for s in range(count)]).T
    np.testing.assert_allclose(strain, expected, rtol=1e-12, atol=1e-13)


def test_points_are_the_same_in_whatever_order_their_materials_stand() -> None:
    rng = np.random.default_rng(6)
    kind = rng.integers(0, len(MATERIALS), 40).astype(np.int8)
    w, mu, lam = rng.uniform(0.5, 2, (3, 40))
    strain = np.array([strained(seed) - I for seed in range(40)]).reshape(40, 9).T
    order = np.argsort(kind, kind="stable")
    mixed, sorted_ = strain.copy(), np.ascontiguousarray(strain[:, order])
    total = weighted_stresses(kind, mixed, w, mu, lam)
    assert weighted_stresses(kind[order], sorted_, w[order], mu[order], lam[order]) == pytest.approx(total, rel=1e-13)
    np.testing.assert_allclose(sorted_, mixed[:, order], rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("number", [-1, len(MATERIALS), 100])
def test_a_number_of_no_material_is_never_taken_for_another(number: int) -> None:
    F, kind = tuple(I.ravel()), np.array([0, number], dtype=np.int8)
    for attempt in (
        lambda: energy(number, F, MU, LAM),
        lambda: energy_stress(number, F, MU, LAM),
        lambda: tangent(number, F, MU, LAM, True),
        lambda: weighted_stresses(kind, np.zeros((9, 2)), np.ones(2), np.ones(2), np.ones(2)),
    ):
        with pytest.raises(ValueError, match="no material has this number"):
            attempt()


def test_a_material_is_refused_by_its_name_where_it_is_not_known() -> None:
    assert material_names([4, 0, 4]) == ["neo_hookean", "linear"]
    with pytest.raises(SceneError, match="ldsim does not know the material 'number 77'; it knows neo_hookean, "):
        material_names([0, 77])
    with pytest.raises(SceneError, match="the page does not know the material 'linear'; it knows neo_hookean$"):
        material_names([0, 4], ["neo_hookean"], "the page")
    with pytest.raises(SceneError, match="unknown material 'rubber'; known are neo_hookean, "):
        material_number("rubber")


def test_one_inverted_point_among_many_makes_the_energy_infinite() -> None:
    strain = np.zeros((9, 3))
    strain[0, 1] = -1.5
    assert weighted_stresses(np.zeros(3, dtype=np.int8), strain, np.ones(3), np.ones(3), np.ones(3)) == np.inf
