"""From a run's folder to a simulator, and what is refused on the way."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import ldsim
from ldsim.artefacts.records import read_cubature, read_model, write_cubature, write_model
from ldsim.errors import ArtefactError
from ldsim.simulator import load
from ldsim.space.novelty import Novelty
from tests.simulator.playable import KP, K, R, header


def test_the_package_loads_a_run() -> None:
    assert ldsim.load is load
    with pytest.raises(AttributeError, match="no attribute 'laod'"):
        ldsim.laod  # noqa: B018


@pytest.mark.parametrize(("space", "size"), [("latent", K), ("linear", KP), ("full", None)])
def test_every_space_of_a_run_is_pulled_towards_the_target(playable: Path, space: str, size: int | None) -> None:
    sim = load(playable, space)
    assert len(sim.coordinates) == (size or 3 * sim.scene.mesh.n_vertices)
    sim.gravity = (0, 0, 0)
    tip = sim.surface.rest[sim.surface.rest[:, 0].argmax()]
    pull = sim.grab(tip, tip + np.array([0, 0.05, 0]))
    sim.step(20)
    assert sim.displacement()[pull.vertices, 1].mean() > 1e-3
    assert sim.time == pytest.approx(20 * sim.scene.time_step)


def test_a_smaller_cubature_can_be_asked_for(playable: Path) -> None:
    every, few = load(playable, "linear"), load(playable, "linear", points=5)
    assert len(few.space.rule.points) < len(every.space.rule.points) == every.scene.points.n_points


def test_virtual_points_are_stepped_unless_points_of_the_mesh_are_asked_for(playable: Path) -> None:
    stored = read_cubature(playable / "cubature.h5")[0]["latent"]
    assert stored.virtual is not None
    few = len(stored.virtual.rule.points)
    virtual, on_mesh, again = load(playable), load(playable, points=few), load(playable, points=few)
    for sim in (virtual, on_mesh, again):
        assert len(sim.space.rule.points) == few
        sim.step(5)
    assert np.array_equal(on_mesh.coordinates, again.coordinates)
    assert np.abs(virtual.coordinates - on_mesh.coordinates).max() > 1e-6


def test_the_full_space_needs_the_scene_alone(own_run: Path) -> None:
    for kind in ("basis", "model", "cubature"):
        (own_run / f"{kind}.h5").unlink()
    assert load(own_run, "full").step().outcome.name == "SOLVED"


@pytest.mark.parametrize(("kind", "stage"), [("scene", "mesh"), ("model", "train"), ("cubature", "cubature")])
def test_a_run_without_an_artefact_says_which_stage_makes_it(own_run: Path, kind: str, stage: str) -> None:
    (own_run / f"{kind}.h5").unlink()
    with pytest.raises(ArtefactError, match=f"{kind}.h5 does not exist; run `ldsim {stage}` first"):
        load(own_run)


def test_a_run_that_knows_its_training_codes_tells_how_far_the_state_is_from_them(own_run: Path) -> None:
    assert np.isnan(load(own_run).novelty)
    model, _ = read_model(own_run / "model.h5")
    novelty = Novelty(np.zeros((1, R)), 0.5, 0.25)
    write_model(own_run / "model.h5", header(own_run, "model", activation="elu"), replace(model, novelty=novelty))
    cubature, _ = read_cubature(own_run / "cubature.h5")
    write_cubature(own_run / "cubature.h5", header(own_run, "cubature"), cubature)
    sim = load(own_run)
    assert sim.novelty == 0.0
    sim.step(5)
    np.testing.assert_allclose(sim.novelty, 8 * np.linalg.norm(sim.save().state.z), rtol=1e-12)
    assert np.isnan(load(own_run, "linear").novelty)
