"""The materials on tensors against the compiled ones, and against finite differences."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from ldsim.dynamics.batched.materials import TWINS, rotation, twins
from ldsim.errors import SceneError
from ldsim.mechanics.materials import MATERIALS
from ldsim.mechanics.materials.kernels import energy_stress
from tests.helpers import derivative_order, random_rotation
from tests.mechanics import material_vectors as vectors

Array = NDArray[np.float64]
MU, LAM = 3e4, 2e5


def gradients(count: int, spread: float, seed: int = 0) -> Array:
    """Deformation gradients around rotations, none of them inverted for a small spread, (count, 3, 3)."""
    rng = np.random.default_rng(seed)
    return np.stack([random_rotation(rng) @ (np.eye(3) + spread * rng.normal(size=(3, 3))) for _ in range(count)])


def components_first(F: Array) -> torch.Tensor:
    return torch.tensor(F.transpose(1, 2, 0)[:, :, None])


@pytest.mark.parametrize("name", TWINS)
def test_density_stress_and_tangent_are_those_of_the_committed_vectors(name: str) -> None:
    cases = vectors.read()[name]
    F, dF = (np.reshape([case[key] for case in cases], (-1, 3, 3)) for key in ("F", "dF"))
    mu, lam, material = torch.tensor(vectors.MU).double(), torch.tensor(vectors.LAM).double(), TWINS[name]
    density = material.density(components_first(F), mu, lam)[0].numpy()
    stress = material.stress(components_first(F), mu, lam)[:, :, 0].numpy().transpose(2, 0, 1)
    directions = components_first(F)[:, :, :, None], components_first(dF)[:, :, :, None]
    change = material.tangent(*directions, mu, lam)[:, :, 0, 0].numpy().transpose(2, 0, 1)
    for i, case in enumerate(cases):
        if case["density"] is None:
            assert density[i] == np.inf
            continue
        assert density[i] == pytest.approx(case["density"], rel=1e-9, abs=1e-9)
        np.testing.assert_allclose(stress[i].ravel(), case["stress"], rtol=1e-8, atol=1e-7 * vectors.MU)
        np.testing.assert_allclose(change[i].ravel(), case["change"], rtol=1e-7, atol=1e-6 * vectors.MU)


@pytest.mark.parametrize("spread", [0.15, 0.8], ids=["moderate", "some inverted"])
@pytest.mark.parametrize("name", TWINS)
def test_density_and_stress_are_those_of_the_compiled_material(name: str, spread: float) -> None:
    F = gradients(40, spread)
    mu, lam = torch.tensor(MU).double(), torch.tensor(LAM).double()
    material = TWINS[name]
    density = material.density(components_first(F), mu, lam)[0].numpy()
    stress = material.stress(components_first(F), mu, lam)[:, :, 0].numpy().transpose(2, 0, 1)
    for i in range(len(F)):
        expected, P = energy_stress(MATERIALS[name], tuple(F[i].ravel()), MU, LAM)
        assert density[i] == pytest.approx(expected, rel=1e-9)
        if np.isfinite(expected):
            np.testing.assert_allclose(stress[i].ravel(), P, rtol=1e-8, atol=1e-7 * MU)


def test_a_material_without_a_twin_is_refused_by_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    assert twins([0, 4]) == [TWINS["neo_hookean"], TWINS["linear"]]
    monkeypatch.delitem(TWINS, "linear")
    with pytest.raises(SceneError, match="the batched stepper does not know the material 'linear'; it knows neo_h"):
        twins([0, 4])


@pytest.mark.parametrize("name", TWINS)
def test_the_tangent_is_the_derivative_of_the_stress(name: str) -> None:
    material, mu, lam = TWINS[name], torch.tensor(MU).double(), torch.tensor(LAM).double()
    rng = np.random.default_rng(2)
    F, X = gradients(5, 0.2, seed=1), rng.normal(size=(5, 3, 3))

    def stress(values: Array) -> Array:
        return material.stress(components_first(values), mu, lam).numpy()

    def along(values: Array) -> Array:
        direction = components_first(X)[:, :, :, None]
        return material.tangent(components_first(values)[:, :, :, None], direction, mu, lam)[:, :, :, 0].numpy()

    assert derivative_order(stress, along, F, X, size=0.1) > 1.9


def test_the_rotation_is_the_polar_one_and_stays_a_rotation_where_the_solid_is_inverted() -> None:
    F = gradients(50, 0.8, seed=3)
    assert (np.linalg.det(F) < 0).any()
    found = rotation(components_first(F))[0][:, :, 0].numpy().transpose(2, 0, 1)
    for given, R in zip(F, found, strict=True):
        U, _, Vt = np.linalg.svd(given)
        U[:, 2] *= np.linalg.det(U @ Vt)
        np.testing.assert_allclose(R, U @ Vt, atol=1e-8)
