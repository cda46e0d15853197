"""A run: opened lazily, checked once, and the spaces and steppers that it makes."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ldsim.artefacts.records import read_model, write_model, write_scene
from ldsim.artefacts.store import file_hash
from ldsim.dynamics.full.options import FullOptions
from ldsim.dynamics.full.stepper import FullStepper
from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.dynamics.stepper import Stepper
from ldsim.errors import ArtefactError
from ldsim.learn.options import TrainOptions
from ldsim.mechanics.loads import Loads
from ldsim.run import Run
from ldsim.space.space import Space
from tests.report import small_run
from tests.simulator.playable import KP, K, R, header, solid


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Run]:
    """A run with snapshots of two motions."""
    path = tmp_path_factory.mktemp("small")
    small_run.write_run(path)
    with Run.open(path) as run:
        yield run


def test_a_run_says_what_lies_in_its_folder(own_run: Path, tmp_path: Path) -> None:
    said = repr(Run.open(own_run))
    assert said.startswith(f"<Run: playable in {own_run}, scene, ") and "simulation" not in said
    assert repr(Run(tmp_path / "new")) == f"<Run: new in {tmp_path / 'new'}, nothing yet>"


def test_a_run_reads_nothing_before_it_is_asked_for(own_run: Path) -> None:
    for kind in ("basis", "model", "cubature"):
        (own_run / f"{kind}.h5").write_bytes(b"no artefact")
    run = Run.open(own_run)
    assert run.experiment == "playable"
    assert run.scene.mesh.n_vertices == solid(1).mesh.n_vertices
    assert run.space("full").r == 3 * run.scene.mesh.n_vertices
    for kind in ("basis", "model", "cubature"):
        with pytest.raises(ArtefactError, match=f"{kind}.h5"):
            getattr(run, kind)


def test_an_artefact_is_read_once(playable: Path) -> None:
    run = Run.open(playable)
    for kind in ("scene", "pca", "model", "cubature"):
        assert getattr(run, kind) is getattr(run, kind)
    assert run.basis is run.pca.basis


def test_what_is_no_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ArtefactError, match="nothing is not the folder of a run; give one such as runs/demo"):
        Run.open(tmp_path / "nothing")
    with pytest.raises(ArtefactError, match="scene.h5 does not exist; run `ldsim mesh` first"):
        Run.open(tmp_path)


def test_an_artefact_of_another_scene_is_refused_by_name(own_run: Path) -> None:
    write_scene(own_run / "scene.h5", header(own_run, "scene"), replace(solid(1), gravity=np.zeros(3)))
    run = Run.open(own_run)
    assert not run.scene.gravity.any()
    for _ in range(2):  # what was refused is not kept
        with pytest.raises(ArtefactError, match="basis.h5 was made from another scene than .*scene.h5"):
            run.basis  # noqa: B018
    with pytest.raises(ArtefactError, match="cubature.h5 was made from another scene than .*scene.h5"):
        run.cubature  # noqa: B018


def test_an_artefact_of_another_experiment_is_refused_by_name(playable: Path) -> None:
    run = Run(playable, "other")
    with pytest.raises(ArtefactError, match="scene.h5 belongs to the experiment 'playable', expected 'other'"):
        run.scene  # noqa: B018


def test_what_a_stage_has_written_is_read_anew(own_run: Path) -> None:
    run = Run.open(own_run)
    before, hash_before = run.model, run.hash("model")
    stored, _ = read_model(own_run / "model.h5")
    write_model(own_run / "model.h5", header(own_run, "model", activation="elu"), replace(stored, kp=KP - 1))
    assert run.model is before and run.hash("model") == hash_before
    run.written("model")
    assert run.model.kp == KP - 1 and run.hash("model") != hash_before
    with pytest.raises(ArtefactError, match="cubature.h5 was made from another model"):
        run.space("linear")


def test_what_was_made_of_a_scene_that_is_written_anew_is_not_taken_from_memory(own_run: Path) -> None:
    run = Run.open(own_run)
    assert run.basis and run.cubature
    write_scene(own_run / "scene.h5", header(own_run, "scene"), replace(solid(1), gravity=np.zeros(3)))
    run.written("scene")
    for kind in ("basis", "cubature"):
        with pytest.raises(ArtefactError, match=f"{kind}.h5 was made from another scene than .*scene.h5"):
            getattr(run, kind)


def test_nor_are_snapshots(small: Run, tmp_path: Path) -> None:
    folder = shutil.copytree(small.folder, tmp_path / small.folder.name)
    with Run.open(folder) as run:
        assert run.snapshots.names == list(run.motions)
        write_scene(folder / "scene.h5", run.header("scene"), replace(run.scene, gravity=np.zeros(3)))
        run.written("scene")
        with pytest.raises(ArtefactError, match="snapshots.h5 was made from another scene than .*scene.h5"):
            run.snapshots  # noqa: B018


def test_an_input_that_is_replaced_while_a_stage_runs_is_told_by_what_was_read(own_run: Path) -> None:
    run = Run.open(own_run)
    run.require("scene")
    before = file_hash(own_run / "scene.h5")
    write_scene(own_run / "scene.h5", header(own_run, "scene"), replace(solid(1), gravity=np.zeros(3)))
    assert run.stage("mesh", TrainOptions()).header("scene", ("scene",)).inputs == {"scene": before}


def by_hand(run: Run, name: str) -> Space:
    if name == "full":
        return Space.full(run.scene)
    stored, model = run.cubature[name], run.model
    if name == "linear":
        return Space.linear(run.scene, run.basis, model.kp, stored.stepped())
    return Space.latent(run.scene, run.basis, (model.decoder, model.encoder), stored.stepped())


@pytest.mark.parametrize(("name", "r", "k"), [("latent", R, K), ("linear", KP, KP), ("full", None, None)])
def test_a_space_and_its_stepper_are_those_made_by_hand(
    playable: Path, name: str, r: int | None, k: int | None
) -> None:
    run = Run.open(playable)
    space, expected, size = run.space(name), by_hand(run, name), 3 * run.scene.mesh.n_vertices
    assert (space.name, space.r, space.decoder.k) == (name, r or size, k or size)
    np.testing.assert_array_equal(space.rule.points, expected.rule.points)
    np.testing.assert_array_equal(space.rule.weights, expected.rule.weights)
    alone: Stepper = (  # type: ignore[type-arg]
        FullStepper(run.scene, FullOptions(tolerance=1e-7))
        if name == "full"
        else ReducedStepper(expected, ReducedOptions(tolerance=1e-7))
    )
    for some in (run.stepper(name, 1e-7), run.stepper(space, 1e-7)):
        state, other = some.rest(), alone.rest()
        for _ in range(3):
            state, other = some.step(state, Loads())[0], alone.step(other, Loads())[0]  # type: ignore[arg-type]
        np.testing.assert_array_equal(some.displacement(state), alone.displacement(other))  # type: ignore[arg-type]
    assert np.abs(alone.displacement(other)).max() > 1e-4


def test_the_usual_tolerance_is_that_of_the_space(playable: Path) -> None:
    run = Run.open(playable)
    full, latent = run.stepper("full"), run.stepper("latent")
    assert full.options == FullOptions() and latent.options == ReducedOptions()


def test_at_most_so_many_points_of_the_mesh_can_be_asked_for(playable: Path) -> None:
    run = Run.open(playable)
    every = run.scene.points.n_points
    few = len(run.cubature["latent"].rules[0].points)
    assert run.space("latent").rule.maps is not None
    assert run.space("latent", scene=run.scene).rule is run.cubature["latent"].best  # it may be of another material
    for points, found in ((every, every), (every - 1, few), (few, few)):
        rule = run.space("latent", points).rule
        assert len(rule.points) == found and rule.maps is None
    assert len(run.space("linear").rule.points) == every
    assert len(run.space("linear", few).rule.points) == few


def test_a_space_that_is_none_is_refused(playable: Path) -> None:
    with pytest.raises(ArtefactError, match="space is 'latnet'; known are auto, full, latent, linear"):
        Run.open(playable).space("latnet")


def test_a_motion_is_given_back_as_it_was_recorded(small: Run) -> None:
    assert small.snapshots.names == list(small_run.FRAMES)
    for name, frames in small_run.FRAMES.items():
        recorded = small.recorded(name)
        (drag,) = recorded.motion.drags
        assert (recorded.motion.name, recorded.motion.frames, drag.start, drag.at_rest) == (name, frames, 2, True)
        farthest = np.argsort(-small.scene.mesh.vertices[:, 0], kind="stable")[:3]
        np.testing.assert_array_equal(recorded.held[0], farthest)


def test_a_closed_run_opens_its_snapshots_again(small: Run) -> None:
    first = small.snapshots
    assert small.snapshots is first
    small.close()
    assert small.snapshots is not first
    assert small.recorded("push").motion.frames == small_run.FRAMES["push"]


def test_spaces_of_a_run_whose_pins_stand_still_have_a_lifting_of_nothing(small: Run, playable: Path) -> None:
    lifting = small.space("latent").lifting
    assert lifting is not None and lifting.count == 0
    assert Run.open(playable).space("latent").lifting is None


def test_a_motion_or_an_artefact_that_there_is_none_of_is_named(small: Run) -> None:
    with pytest.raises(ArtefactError, match="^motion 'foo' was not recorded; known are pull_1, push"):
        small.recorded("foo")
    for ask in (small.header, small.hash, small.require):
        with pytest.raises(ArtefactError, match="foo.h5 does not exist"):
            ask("foo")
