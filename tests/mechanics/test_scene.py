"""The scene refuses what is no well-posed problem and knows the weight of the solid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from ldsim.errors import MeshError, SceneError
from ldsim.mesh.shapes import beam, voxel_mesh
from tests.helpers import scene

BEAM = beam(0.4, 0.1, 0.1, resolution=1)

BAD_SCENES = {
    "mu": ({"mu": np.zeros(BEAM.n_cells)}, "mu of a cell is 0; it must be positive"),
    "density": ({"density": np.full(BEAM.n_cells, -1.0)}, "density of a cell is -1"),
    "density not a number": ({"density": np.full(BEAM.n_cells, np.nan)}, "density of a cell is nan"),
    "time step": ({"time_step": 0.0}, "time step is 0 s"),
    "an endless time step": ({"time_step": np.inf}, "time step is inf s"),
    "lam": ({"lam": np.full(BEAM.n_cells, np.nan)}, "bulk modulus of a cell is nan; it must be positive"),
    "a solid that would explode": ({"lam": np.full(BEAM.n_cells, -1e9)}, "bulk modulus of a cell is -"),
    "too few moduli": ({"mu": np.ones(3)}, "have shapes"),
    "gravity": ({"gravity": np.array([0.0, np.nan, 0.0])}, "gravity holds nan"),
    "load": ({"load": np.full((BEAM.n_vertices, 3), np.inf)}, "load holds inf"),
    "a load of another shape": ({"load": np.zeros((3, BEAM.n_vertices))}, "have shapes"),
    "all pinned": ({"pinned": np.ones(BEAM.n_vertices, dtype=bool)}, "the pins hold all .* vertices"),
    "pins by number": ({"pinned": np.arange(BEAM.n_vertices) % 2}, "pinned is of type int64; expected bool"),
    "no pins": ({"pinned": np.zeros(BEAM.n_vertices, dtype=bool)}, "1 of 1 connected parts have no pinned vertex"),
}


@pytest.mark.parametrize("change, message", BAD_SCENES.values(), ids=BAD_SCENES.keys())
def test_what_cannot_be_simulated_is_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        replace(scene(BEAM), **change)  # type: ignore[arg-type]


BAD_CELLS = {
    "twice": (np.vstack([BEAM.cells, BEAM.cells[3:4, [1, 2, 0, 3]]]), "1 of 25 cells are there twice"),
    "without volume": (np.vstack([BEAM.cells, BEAM.cells[:1, [0, 0, 1, 2]]]), "1 of 25 cells are degenerate"),
    "inside out": (BEAM.cells[:, [1, 0, 2, 3]], "24 of 24 cells are inverted"),
}


@pytest.mark.parametrize("cells, message", BAD_CELLS.values(), ids=BAD_CELLS.keys())
def test_a_mesh_that_cannot_be_simulated_makes_no_scene(cells: NDArray[np.int32], message: str) -> None:
    with pytest.raises(MeshError, match=message):
        scene(replace(BEAM, cells=cells))


def test_a_loose_part_is_refused_with_its_size() -> None:
    row = np.array([1, 1, 0, 1], dtype=bool).reshape(4, 1, 1)
    with pytest.raises(SceneError, match="1 of 2 connected parts have no pinned vertex, the first with 8 vertices"):
        scene(voxel_mesh(row, 0.1))


def test_a_loose_part_that_touches_a_pinned_one_is_refused_with_what_is_not_joined() -> None:
    apart = replace(BEAM, vertices=np.vstack([BEAM.vertices, BEAM.vertices + [0.4, 0, 0]]))
    parts = replace(apart, cells=np.vstack([BEAM.cells, BEAM.cells + BEAM.n_vertices]))
    with pytest.raises(SceneError, match="1 of 2 connected parts .*; 8 vertices lie where vertices of another part do"):
        scene(parts)


@pytest.mark.parametrize("cell_type", ["tet4", "hex8"])
def test_the_weight_is_that_of_the_solid_less_what_the_pins_carry(cell_type: str) -> None:
    body = scene(beam(0.4, 0.1, 0.1, 2, cell_type), gravity=(1.0, -2.0, 3.0), density=500.0)
    lumped = np.asarray(body.mass.sum(axis=1)).ravel()
    assert lumped.sum() == pytest.approx(500 * 0.4 * 0.1 * 0.1, rel=1e-12)
    force = body.external_force
    np.testing.assert_allclose(force.sum(axis=0), lumped[body.free].sum() * np.array([1.0, -2.0, 3.0]), rtol=1e-12)
    assert not force[body.pinned].any()
    np.testing.assert_array_equal(np.sort(np.concatenate([body.free, np.flatnonzero(body.pinned)])), range(len(force)))


def test_a_scene_of_a_material_that_does_not_exist_is_refused() -> None:
    body = scene(beam(resolution=1))
    with pytest.raises(SceneError, match="ldsim does not know the material 'number 50'; it knows neo_hookean, "):
        replace(body, material=np.full_like(body.material, 50))


def test_a_stiffened_scene_has_its_lame_parameters_scaled_and_nothing_else_changed() -> None:
    body = scene(beam(resolution=1))
    changed = body.stiffened(2.5)
    np.testing.assert_allclose(changed.mu, 2.5 * body.mu, rtol=1e-15)
    np.testing.assert_allclose(changed.lam, 2.5 * body.lam, rtol=1e-15)
    np.testing.assert_allclose(changed.elements.lam, 2.5 * body.elements.lam, rtol=1e-15)
    np.testing.assert_array_equal(changed.external_force, body.external_force)
    assert changed.mass is body.mass


@pytest.mark.parametrize(
    ("material", "ratio"), [("neo_hookean", 0.0), ("neo_hookean", -0.1), ("fixed_corotated", -0.1)]
)
def test_a_material_that_a_change_of_volume_costs_nothing_is_refused(material: str, ratio: float) -> None:
    with pytest.raises(
        SceneError, match=f"cell 0 is of {material} with Poisson's ratio {ratio:g}, .*give a greater one"
    ):
        scene(BEAM, material, poisson_ratio=ratio)


@pytest.mark.parametrize(
    ("material", "ratio"), [("stable_neo_hookean", -0.1), ("fixed_corotated", 0.0), ("linear", -0.1)]
)
def test_a_material_that_resists_it_otherwise_may_have_such_a_ratio(material: str, ratio: float) -> None:
    assert scene(BEAM, material, poisson_ratio=ratio).lam.max() <= 0
