"""What is said of a solid before anything runs: scaling laws, and warnings where it makes no sense."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ldsim.mechanics.options import PullOptions
from ldsim.mechanics.scene import Scene
from ldsim.mesh.mesh import Mesh
from ldsim.mesh.shapes import beam
from ldsim.mesh.surface import surface_vertices
from ldsim.pipeline.options import MotionOptions, SnapshotOptions
from ldsim.pipeline.solid import Solid, described, look_at, moved_by, solid_lines, usual_radius
from tests.helpers import scene as scene_of


def rod(youngs_modulus: float = 1e6, size: float = 1.0, upright: bool = False) -> Scene:
    made = beam(0.3, 0.05, 0.06, 2, cell_type="hex8")  # no square, so that one direction is the softest
    gravity = (-9.81, 0.0, 0.0) if upright else (0.0, -9.81, 0.0)
    mesh = Mesh(size * made.vertices, made.cells, made.cell_type)
    return scene_of(mesh, "stable_neo_hookean", youngs_modulus, 0.45, gravity=gravity)


def solid(scene: Scene) -> Solid:
    found = look_at(scene)
    assert found is not None
    return found


def test_a_solid_made_stiffer_is_what_its_scaled_description_says() -> None:
    soft, stiff = solid(rod()), solid(rod(1e7))
    told = soft.stiffened(10)
    for name in ("size", "weight", "radius", "sag", "load_factor", "frequencies", "softness", "strain"):
        np.testing.assert_allclose(getattr(told, name), getattr(stiff, name), rtol=2e-3, err_msg=name)


def test_a_solid_of_twice_the_size() -> None:
    small, large = solid(rod()), solid(rod(size=2.0))
    factors = {"size": 2, "weight": 8, "radius": 2, "sag": 4, "load_factor": 0.5, "period": 2}
    for name, factor in factors.items():
        assert getattr(large, name) == pytest.approx(factor * getattr(small, name), rel=2e-3), name
    np.testing.assert_allclose(large.softness, small.softness / 2, rtol=1e-6)
    np.testing.assert_allclose(large.strain, small.strain / 2, rtol=1e-6)


def test_a_grip_holds_a_hundredth_of_the_surface_or_the_vertices_around_one() -> None:
    cube = scene_of(beam(0.2, 0.2, 0.2, 12, cell_type="hex8"))
    assert np.pi * usual_radius(cube) ** 2 == pytest.approx(0.01 * 6 * 0.2**2, rel=1e-6)
    coarse = scene_of(beam(0.2, 0.2, 0.2, 2, cell_type="hex8"))
    assert usual_radius(coarse) >= 0.1


def test_what_is_derived_of_it_hardly_hangs_on_the_order_of_its_vertices() -> None:
    made, found = beam(0.3, 0.05, 0.06, 4), []
    for seed in range(4):
        order = np.random.default_rng(seed).permutation(len(made.vertices))
        cells = np.argsort(order)[made.cells].astype(made.cells.dtype)
        there = solid(scene_of(Mesh(made.vertices[order], cells, made.cell_type), "stable_neo_hookean", 1e6, 0.45))
        found.append((np.median(there.softness), np.median(there.strain)))
    assert (np.max(found, axis=0) < 1.4 * np.min(found, axis=0)).all()


def test_half_of_a_pull_as_stiff_as_the_solid_goes_into_it() -> None:
    found = solid(rod())
    pulls = PullOptions(count=1, reach=0.1, stiffness=1 / found.softness[0])
    moved = moved_by(found, pulls)
    assert moved[0] == pytest.approx(0.05)
    assert (moved < 0.1).all() and (np.argsort(moved) == np.argsort(found.softness)).all()


@pytest.mark.parametrize(
    ("scene", "pulls", "words"),
    [
        (rod(1e7), PullOptions(count=1, reach=0.05, stiffness=100.0), None),
        (rod(3e5), None, "sinks into a heap"),
        (rod(3e3, upright=True), None, "buckles under"),
        (rod(1e7), PullOptions(count=1, reach=0.05, stiffness=1e-3), "hardly move it"),
        (rod(1e7), PullOptions(count=1, reach=5.0, stiffness=1e6), "cells will invert"),
        (rod(1e7), PullOptions(count=1, reach=0.05, stiffness=100.0, radius=0.2), "a grip of 200 mm holds "),
    ],
    ids=["sensible", "heap", "buckled", "still", "torn", "embraced"],
)
def test_what_is_absurd_is_warned_of(scene: Scene, pulls: PullOptions | None, words: str | None) -> None:
    found = look_at(scene, pulls.radius if pulls else None)
    assert found is not None
    warnings = [line for line in described(found, [pulls] if pulls else []) if line.startswith("warning")]
    assert [words in line for line in warnings] == [True] if words else not warnings


def test_what_a_warning_advises_is_enough() -> None:
    found = solid(rod(3e3, upright=True))
    line = next(line for line in described(found) if "buckles" in line)
    factor = float(line.split(" times stiffer")[0].split()[-1])
    assert not [line for line in described(found.stiffened(factor)) if line.startswith("warning")]


def test_pins_that_let_a_solid_turn_are_told_and_stop_nothing() -> None:
    mesh = beam(0.3, 0.05, 0.05, 2, cell_type="hex8")
    x = mesh.vertices
    hinge = (x[:, 0] < 1e-9) & (x[:, 1] < x[:, 1].min() + 1e-9)
    held = scene_of(mesh)
    loose = Scene(mesh, held.material, held.mu, held.lam, held.density, hinge, held.gravity, 0.01)
    pulls = PullOptions(count=1, reach=0.1)
    options = SnapshotOptions(motions=(MotionOptions(name="a", pulls=pulls),))
    assert solid_lines(loose, options)[0].startswith("warning: ")
    assert len(solid_lines(held, options)) >= 3


def test_a_solid_whose_pins_hold_all_of_its_surface_is_told_and_stops_nothing() -> None:
    mesh = beam(0.3, 0.05, 0.05, 2, cell_type="hex8")
    held = replace(scene_of(mesh), pinned=np.isin(np.arange(mesh.n_vertices), surface_vertices(mesh)))
    assert len(held.free)
    options = SnapshotOptions(motions=(MotionOptions(name="a", pulls=PullOptions(count=1, reach=0.1)),))
    (line,) = solid_lines(held, options)
    assert line.startswith("warning: what the solid does at rest is not known: no vertex of the surface can move")
