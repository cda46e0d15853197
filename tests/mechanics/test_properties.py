"""Material properties cell by cell: changes in parts, what is refused, and back from a scene's Lamé parameters."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ldsim.errors import SceneError
from ldsim.mechanics.materials import MATERIALS
from ldsim.mechanics.properties import Properties, lame_parameters
from ldsim.mechanics.scene import properties_of, with_properties
from ldsim.mesh.shapes import beam
from tests.helpers import uniform_scene

LEFT = np.array([True, True, False, False])


def uniform() -> Properties:
    return Properties.uniform(4, "neo_hookean", 1e5, 0.4, 1000.0)


def test_a_change_is_made_in_its_cells_alone_and_leaves_the_rest_of_them() -> None:
    changed = uniform().changed(LEFT, model="linear", youngs_modulus=3e5, density=7.0)
    assert changed.kind.tolist() == [MATERIALS["linear"]] * 2 + [MATERIALS["neo_hookean"]] * 2
    assert changed.kind.dtype == np.int8
    assert changed.youngs_modulus.tolist() == [3e5, 3e5, 1e5, 1e5]
    assert changed.density.tolist() == [7, 7, 1000, 1000]
    assert changed.poisson_ratio.tolist() == [0.4] * 4


def test_changes_add_up_and_the_last_one_wins() -> None:
    twice = uniform().changed(youngs_modulus=np.arange(1.0, 5.0)).changed(LEFT, youngs_factor=10.0)
    assert twice.youngs_modulus.tolist() == [10, 20, 3, 4]
    assert twice.changed(youngs_modulus=5.0, youngs_factor=2.0).youngs_modulus.tolist() == [10] * 4


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"youngs_modulus": np.array([1.0, 2, -3, 4])}, "Young's modulus of cell 2 is -3; it must be positive"),
        ({"poisson_ratio": np.nextafter(0.5, 0)}, "Poisson's ratio of cell 0 is 0.5; .* less than 0.5"),
        ({"poisson_ratio": np.array([0, 0.5, 0.3, 0.1])}, "Poisson's ratio of cell 1 is 0.5; .* less than 0.5"),
        ({"poisson_ratio": np.array([0, np.nan, 0.3, 0.1])}, "Poisson's ratio of cell 1 is nan"),
        ({"density": np.array([0.0, 1, 1, 1])}, "density of cell 0 is 0; it must be positive"),
        ({"density": np.array([1.0, 1, 1, np.inf])}, "density of cell 3 is inf"),
    ],
)
def test_numbers_that_are_no_material_are_refused_with_their_cell(change: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        uniform().changed(**change)


@pytest.mark.parametrize("ratio", [-0.5, 0.0, 0.3, 0.49])
def test_the_properties_of_a_scene_are_those_it_was_made_of(ratio: float) -> None:
    mesh = beam(resolution=1)
    numbers = {"youngs_modulus": 2e5, "poisson_ratio": ratio, "density": 900.0}
    body = uniform_scene(mesh, mesh.vertices[:, 0] == 0, material="stable_neo_hookean", **numbers)
    found = properties_of(body)
    np.testing.assert_allclose(found.youngs_modulus, 2e5, rtol=1e-12)
    np.testing.assert_allclose(found.poisson_ratio, ratio, atol=1e-12)
    softer = with_properties(body, found.changed(youngs_factor=0.5))
    np.testing.assert_allclose(softer.mu, body.mu / 2, rtol=1e-12)
    np.testing.assert_allclose(softer.lam, body.lam / 2, rtol=1e-12, atol=1e-6)
    assert softer.mass.sum() == body.mass.sum()


def test_lame_parameters_give_back_youngs_modulus_and_poissons_ratio() -> None:
    mu, lam = lame_parameters(2e5, 0.3)
    assert mu * (3 * lam + 2 * mu) / (lam + mu) == pytest.approx(2e5, rel=1e-14)
    assert lam / (2 * (lam + mu)) == pytest.approx(0.3, rel=1e-14)
