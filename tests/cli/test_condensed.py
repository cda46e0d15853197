"""A condensed latent space through every stage, in the simulator, and where it is refused."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ldsim.arrays import Array
from ldsim.artefacts.records import read_model, write_model
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.dynamics.simulate import simulate
from ldsim.errors import SolverError
from ldsim.export.arrays import model_arrays
from ldsim.export.playback import playback
from ldsim.learn.options import OF_AUTOENCODER, TrainOptions
from ldsim.mechanics.motion import Motion
from ldsim.pipeline import condense, relaxed_poses, swing
from ldsim.pipeline.comparison import Reference, run_reduced, with_errors
from ldsim.pipeline.convergence import pull_errors
from ldsim.pipeline.coordinates import combined, slowest
from ldsim.pipeline.cubature import TrainingPoses
from ldsim.pipeline.progress import SILENT
from ldsim.pipeline.train import train
from ldsim.report.overview import report_of
from ldsim.report.remedies import Facts
from ldsim.report.runs import displacements
from ldsim.run import Run
from ldsim.simulator import Simulator, load
from ldsim.space.basis import Basis
from ldsim.space.relaxation import Relaxation, Relaxed
from ldsim.space.space import Space
from tests.cli.experiments import TINY, Experiment

SMALL = {
    "poses": 24,
    "shell": 1,
    "rounds": 1,
    "explored": 6,
    "points": 8,
    "features": 4,
    "columns": 6,
    "steps": 300,
    "modes": 4,
}
CONDENSED: dict[str, Any] = TINY | {"train": {"kind": "condensed", "r": 3, "hidden": [12], "condensed": SMALL}}


@pytest.fixture(scope="module", autouse=True)
def slowest_coordinates() -> Iterator[None]:
    """They are not the columns of the basis, so that nothing may take these for the coordinates."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(condense, "needed_coordinates", lambda run, r, progress: slowest(run)[:, :r])
        yield


@pytest.fixture(scope="module")
def condensed(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    experiment = Experiment(tmp_path_factory.mktemp("condensed"))
    experiment.configure(CONDENSED)
    for stage in ("mesh", "snapshot", "pca", "train", "cubature", "simulate", "report"):
        result = experiment.invoke(stage)
        assert result.exit_code in ((0, 3) if stage == "cubature" else (0,)), result.output
    return experiment


@pytest.fixture
def again(condensed: Experiment, tmp_path: Path) -> Experiment:
    """A copy of it for one test alone."""
    shutil.copytree(condensed.folder, tmp_path, dirs_exist_ok=True)
    return Experiment(tmp_path)


def coordinates(run: Run) -> Basis:
    """V."""
    return combined(run.basis, slowest(run)[:, :3])


def simulator(experiment: Experiment) -> Simulator:
    """In the latent space with V_eff, whatever the judge of the cubature thought of so small a fit."""
    with Run(experiment.run) as run:
        rule = run.model.potential
        assert rule is not None
        space = run.space("latent").with_rule(rule)
        return Simulator(space, run.stepper(space))


def test_layers_that_are_left_out_are_those_of_the_mesh_and_advice_knows_them(
    again: Experiment, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ldsim.learn.options.MANY", 0)
    again.configure(TINY | {"train": {"r": 3, "condensed": SMALL | {"rounds": 0, "steps": 20}}})
    numbers = report_of(again.run)
    assert numbers is not None and again.invoke("train").exit_code == 0
    with Run(again.run) as run:
        assert run.model.decoder.layers.sizes.tolist()[1:-1] == [80, 80, 80, 80]
        assert Facts.of(run, numbers).train.hidden == (80, 80, 80, 80)


def test_its_coordinates_are_combinations_of_the_basis_and_its_rest_is_exact(condensed: Experiment) -> None:
    with Run(condensed.run) as run:
        space, u, V = run.space("latent"), run.snapshots.reader("a")(0, 20), coordinates(run)
        assert np.abs(V.matrix - run.basis.matrix[:, :3]).max() > 0.01 * np.abs(V.matrix).max()
        z, _ = space.encode(u)
        np.testing.assert_allclose(z, V.project(u), rtol=1e-6, atol=1e-12)
        np.testing.assert_array_equal(space.decoder(np.zeros(3)), 0)
        # what is slaved is orthogonal to the coordinates, so that every decoded pose has the z it was decoded from
        poses = space.displacement(space.decoder(z))
        np.testing.assert_allclose(V.project(poses), z, atol=1e-9 * np.abs(z).max())


def test_cubature_sees_training_poses_in_its_coordinates(condensed: Experiment) -> None:
    with Run(condensed.run) as run:
        poses = TrainingPoses(run, 1)
        V, u = coordinates(run), run.basis.displacement(poses.q)
        np.testing.assert_allclose(poses.latent().z, V.project(u), atol=1e-9 * np.abs(u).max())


def test_small_motions_move_what_is_slaved_as_the_solid_does(condensed: Experiment) -> None:
    with Run(condensed.run) as run:
        space = run.space("latent")
        # ∂u/∂z = T₀ at rest in every vertex, of no more modes than were asked for beside it
        T = Relaxation(run.scene, coordinates(run)).rest.tangents
        np.testing.assert_allclose(
            space.basis.fields @ space.decoder.jacobian(np.zeros(3)), T, atol=1e-6 * abs(T).max()
        )
        assert space.decoder.k == 3 + SMALL["features"] + 3 + SMALL["columns"] + len(space.squares)


def swung(run: Run) -> tuple[Space, Space]:
    """The space without modes, and what is made of it where four may swing."""
    model = run.model
    assert model.potential is not None
    networks = model.decoder, model.encoder
    space = Space.condensed(run.scene, run.basis_of("latent"), networks, model.potential)
    return space, swing.better_swinging(run, space, Relaxation(run.scene, coordinates(run)), 4, SILENT)


@pytest.mark.parametrize("validation, better", [(0.014, True), (0.015, False), (np.inf, False)])
def test_modes_swing_where_motions_of_both_roles_are_a_tenth_less_off_in_the_geometric_mean(
    condensed: Experiment, validation: float, better: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    judged, told = list[list[str]](), list[str]()

    def error(run: Run, space: Space, names: list[str], update: Callable[[], object]) -> float:
        judged.append(list(names))
        if not len(space.squares):
            return 0.02
        return validation if names == run.snapshots.with_role("validation") else 0.0225

    monkeypatch.setattr(swing, "online_error", error)
    monkeypatch.setattr(SILENT, "tell", told.append)
    with Run(condensed.run) as run:
        space, found = swung(run)
        assert judged == [run.snapshots.with_role(role) for role in ("train", "validation")] * 3
    assert len(found.squares) == (4 if better else 0) and (found is space) != better
    (line,) = told
    assert line.startswith("note: 4 modes beside the coordinates " + ("swing" if better else "are kept"))
    assert "2.2 % off on train motions where they swing, 2 % off where not" in line


@pytest.mark.parametrize("turns", [True, False])
def test_what_modes_have_of_a_dent_turns_where_that_is_less_off_and_is_kept_with_the_model(
    condensed: Experiment, turns: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def error(run: Run, space: Space, names: list[str], update: Callable[[], object]) -> float:
        return 0.02 if not len(space.squares) else 0.010 if space.turns == turns else 0.011

    monkeypatch.setattr(swing, "online_error", error)
    with Run(condensed.run) as run:
        _, found = swung(run)
        assert len(found.squares) == 4 and found.turns == turns
        write_model(tmp_path / "model.h5", run.header("model"), replace(run.model, squares=found.squares, turns=turns))
    assert read_model(tmp_path / "model.h5")[0].turns == turns


@pytest.mark.parametrize(
    ("swung", "kept", "better"),
    [
        ((np.inf, 0.01), (np.inf, 0.02), True),
        ((np.inf, 0.01), (0.5, 0.02), False),
        ((0.01, 0.5), (0.02, np.inf), True),
        ((np.inf, np.inf), (np.inf, np.inf), False),
    ],
)
def test_a_role_that_is_lost_both_ways_tells_nothing(
    swung: tuple[float, float], kept: tuple[float, float], better: bool
) -> None:
    assert swing._less(swung, kept, 0.9) == better


def test_how_far_a_space_is_off_is_told_of_all_frames_together(condensed: Experiment) -> None:
    with Run(condensed.run) as run:
        space = replace(run.space("latent"), rule=run.model.potential)
        names = [*run.snapshots.with_role("train"), *run.snapshots.with_role("validation")]
        off = moved = 0.0
        for name in names:
            recorded = run.snapshots.recorded(name)
            stepper, frames = ReducedStepper(space, run.reduced_options), run.snapshots.reader(name)
            for frame in simulate(stepper, recorded.motion, held=recorded.held):
                u = frames(frame.number, frame.number + 1)[0]
                off += float(np.linalg.norm(stepper.displacement(frame.state) - u, axis=1).mean())
                moved += float(np.linalg.norm(u, axis=1).mean())
        assert swing.online_error(run, space, names, lambda: None) == pytest.approx(off / moved, rel=1e-6)


def test_it_is_judged_pull_by_pull_on_motions_that_are_kept_aside(condensed: Experiment) -> None:
    with Run(condensed.run) as run:
        (name,) = run.snapshots.with_role("validation")
        recorded, rule = run.snapshots.recorded(name), run.model.potential
        assert rule is not None
        space = run.space("latent").with_rule(rule)
        reference = Reference(recorded.motion, recorded.held, run.snapshots.reader(name))
        starts = [drag.start for drag in recorded.motion.drags]
        played = run_reduced(ReducedStepper(space, run.reduced_options), reference, restarts=starts)
        whole = with_errors(played, space, reference).relative_error
        errors = pull_errors(run)
    assert whole is not None and len(errors) == len(recorded.motion.drags)
    assert errors.min() * 0.999 <= whole <= errors.max() * 1.001


def test_it_stands_beside_the_linear_space_of_as_many_coordinates(condensed: Experiment) -> None:
    with Run(condensed.run) as run:
        errors = run.simulation["latent"]["a"].relative_error, run.simulation["linear"]["a"].relative_error
        assert errors[0] is not None and np.isfinite(errors[0])
        assert not run.simulation["latent"]["b"].diverged


def test_a_grab_pulls_with_the_force_that_its_handle_tells(condensed: Experiment) -> None:
    sim = simulator(condensed)
    top = sim.scene.mesh.vertices[:, 1].argmax()
    target = sim.scene.mesh.vertices[top] + [0.02, 0.0, 0.0]
    handle = sim.grab(sim.scene.mesh.vertices[top], target, stiffness=50.0, radius=0.02)
    for _ in range(1000):
        sim.step()
    assert handle.force[0] > 0
    # the dent is solved for by three Newton steps, and what they leave is in the centroid
    np.testing.assert_allclose(handle.force, 50.0 * (target - handle.centroid), rtol=1e-6)
    # at rest, the force of the grab and gravity balance the elastic force: their work in every coordinate is nothing
    still = sim.displacement()
    sim.step()
    np.testing.assert_allclose(sim.displacement(), still, atol=1e-5)


def test_two_grabs_feel_each_other(condensed: Experiment) -> None:
    with Run(condensed.run) as run:
        compliance = run.space("latent").compliance
        assert compliance is not None
        sim = simulator(condensed)
        x = sim.scene.mesh.vertices
        grabs = [
            sim.grab(x[v], x[v], stiffness=50.0, radius=0.02).grab for v in np.flatnonzero(x[:, 1] > 0.07)[[0, -1]]
        ]
        together = np.linalg.inv(np.eye(6) / 50.0 + compliance.between([grab.vertices for grab in grabs]))
        np.testing.assert_allclose(together, together.T)
        assert np.linalg.eigvalsh(together)[0] > 0
        assert np.abs(together[:3, 3:]).max() > 1e-9 * np.abs(together).max()
        assert (np.diag(together) < 50.0).all()  # in series each is softer than its spring


def test_let_go_its_energy_never_rises(condensed: Experiment) -> None:
    with Run(condensed.run) as run:
        rule = run.model.potential
        assert rule is not None
        stepper = run.stepper(run.space("latent").with_rule(rule), tolerance=1e-9)
    assert isinstance(stepper, ReducedStepper)
    start, M = stepper.rest(), stepper.mass / stepper.scene.time_step**2
    start.data[:3] = 0.02 * np.sqrt(stepper.scene.mass.sum()) * np.array([1.0, -0.5, 0.3])
    energies, before = [], np.zeros((2, stepper.space.decoder.k))
    for frame in simulate(stepper, Motion("free", 60, ()), start):
        q = frame.state.q
        inertia, velocity = q - 2 * before[0] + before[1], q - before[0]
        # the value of a step is its inertia term and the potential, to which the kinetic energy is added
        energies.append(frame.solution.value - 0.5 * inertia @ M @ inertia + 0.5 * velocity @ M @ velocity)
        before = np.array([q, before[0]])
    # the first two steps are told from a start whose q is not that of its z
    assert (np.diff(energies[2:]) <= 1e-6 * np.ptp(energies)).all()
    assert energies[-1] < energies[2]


def test_a_round_runs_the_model_itself_under_loads_that_no_motion_had(condensed: Experiment) -> None:
    with Run(condensed.run) as run:
        options = TrainOptions.model_validate(CONDENSED["train"])
        work = condense._Work(run, Relaxation(run.scene, run.basis.columns(3)), options, SILENT)
        z = work._own_frames(run.space("latent"), 0)
        drags = run.recorded("a").motion.drags
        frames = 2 * int(np.median([len(drag.targets) for drag in drags]))
        assert z.shape == (condense.PULLS * options.condensed.explored * frames, 3)  # not a frame was lost
        # each run starts at rest
        first = np.linalg.norm(z[::frames], axis=1)
        assert (first < 0.5 * np.linalg.norm(z, axis=1).max()).all()


def test_own_poses_are_taken_no_farther_out_than_own_pulls_go(
    again: Experiment, monkeypatch: pytest.MonkeyPatch
) -> None:
    lengths = dict[str, Array]()
    relax = condense._Work.relax

    def watched(work: Any, name: str, z: Array, *rest: Any) -> None:
        lengths[name] = np.linalg.norm(z @ relaxed_poses.energy_root(work.relaxation), axis=1)
        relax(work, name, z, *rest)

    monkeypatch.setattr(condense._Work, "relax", watched)
    monkeypatch.setattr(condense, "FARTHER", 0.5)  # where every own run comes
    (again.run / "model.h5").unlink()
    assert again.invoke("train").exit_code == 0
    farthest = lengths["relaxed"].max()
    assert 0.4 * farthest < lengths["round 1"].max() <= 0.5 * farthest


def test_an_interrupted_relaxation_keeps_what_was_done(again: Experiment, monkeypatch: pytest.MonkeyPatch) -> None:
    with Run(again.run) as run:
        before = run.model.potential
    done, looked, needed = list[int](), list[Array](), condense.needed_coordinates
    relaxed = relaxed_poses.ChosenPoses.relaxed
    monkeypatch.setattr(condense, "needed_coordinates", lambda *given: (looked.append(needed(*given)), looked[-1])[1])

    def interrupted(poses: Any, piece: int) -> dict[str, Any]:
        if piece == 2:
            raise KeyboardInterrupt
        done.append(piece)
        return relaxed(poses, piece)

    (again.run / "model.h5").unlink()
    monkeypatch.setattr(relaxed_poses.ChosenPoses, "relaxed", interrupted)
    assert again.invoke("train").exit_code != 0
    monkeypatch.setattr(
        relaxed_poses.ChosenPoses, "relaxed", lambda poses, piece: (done.append(piece), relaxed(poses, piece))[1]
    )
    assert again.invoke("train").exit_code == 0
    assert len(looked) == 1
    assert done == [0, 1, 2, 0]  # and a piece of the poses that its own runs came to
    with Run(again.run) as run:
        after = run.model.potential
    assert before is not None and after is not None
    np.testing.assert_array_equal(before.weights, after.weights)
    assert not (again.run / "model.partial").exists()


def test_it_reads_no_setting_of_an_autoencoder_and_every_other(
    condensed: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(condensed.folder, tmp_path, dirs_exist_ok=True)
    options, read = TrainOptions(**CONDENSED["train"]), set[str]()

    def noted(self: TrainOptions, name: str) -> Any:
        read.add(name)
        return object.__getattribute__(self, name)

    monkeypatch.setattr(TrainOptions, "without_effect", lambda self: "")  # it looks at every setting
    monkeypatch.setattr(TrainOptions, "__getattribute__", noted, raising=False)
    with Run(tmp_path / "runs" / "tiny") as run:
        train(run, options)
    assert read & set(TrainOptions.model_fields) == set(TrainOptions.model_fields) - set(OF_AUTOENCODER)


def test_wider_layers_learn_from_the_poses_that_narrow_ones_came_to(
    again: Experiment, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(condense, "NARROW", 6)
    again.configure(CONDENSED | {"train": CONDENSED["train"] | {"hidden": [8]}})
    assert again.invoke("train", "--keep").exit_code == 0
    monkeypatch.setattr(relaxed_poses.ChosenPoses, "relaxed", lambda *_: pytest.fail("a pose was relaxed again"))
    again.configure(CONDENSED | {"train": CONDENSED["train"] | {"hidden": [20]}})
    assert again.invoke("train").exit_code == 0
    with Run(again.run) as run:
        assert run.model.decoder.layers.sizes[1] == 20


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"train": {"kind": "condensed", "r": 7}}, "train.r is 7; allowed are 1 … 6"),
        (
            {"pca": {"k": 8}, "train": {"kind": "condensed", "r": 7, "condensed": {"points": 1}}},
            "train.condensed.points is 1; allowed are 2 or more",
        ),
        ({"train": {"kind": "condense"}}, "train.kind"),
    ],
)
def test_what_has_no_condensed_space_is_refused_by_name(again: Experiment, change: dict[str, Any], said: str) -> None:
    again.configure(CONDENSED | change)
    if "pca" in change:
        assert again.invoke("pca").exit_code == 0
    result = again.invoke("train")
    assert result.exit_code == 1 and said in result.output and "Traceback" not in result.output


def test_it_is_loaded_and_exported_like_any_other(condensed: Experiment) -> None:
    sim = load(condensed.run, "latent")
    for _ in range(5):
        sim.step()
    assert np.isfinite(sim.displacement()).all()
    with Run(condensed.run) as run:
        arrays = model_arrays(run)
    assert arrays["latent/basis"].shape[1] == arrays["latent/strain_maps"].shape[2]


def test_a_solid_without_an_equilibrium_wherever_it_was_taken_is_told(
    again: Experiment, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: object) -> Relaxed:
        raise SolverError("a condensed pose has buckled")

    (again.run / "model.h5").unlink()
    monkeypatch.setattr(condense.Relaxation, "from_pose", refused)
    result = again.invoke("train")
    assert result.exit_code == 1 and "none of 48 poses has a stable equilibrium" in result.output


def test_poses_without_an_equilibrium_that_come_together_are_left_out(
    again: Experiment, monkeypatch: pytest.MonkeyPatch
) -> None:
    relaxed = relaxed_poses.ChosenPoses.relaxed

    def first_lost(poses: Any, piece: int) -> dict[str, Any]:
        found = relaxed(poses, piece)
        return {name: each[:0] for name, each in found.items()} if piece == 0 else found

    (again.run / "model.h5").unlink()
    monkeypatch.setattr(relaxed_poses.ChosenPoses, "relaxed", first_lost)
    result = again.invoke("train")
    # of 24 poses the first eight and one beside each, and all six of the round of own runs
    assert result.exit_code == 0, result.output
    assert "28 of 60 poses have no stable equilibrium" in result.output


def test_what_is_replayed_and_exported_is_as_far_from_the_full_space_as_the_errors_say(condensed: Experiment) -> None:
    with Run(condensed.run) as run:
        for name, trajectory in run.simulation["latent"].items():
            full, errors = run.played.reader(name)(0, run.played.frames(name)), trajectory.mean_error
            assert errors is not None and errors.max() > 0
            played = playback(run, name, "latent")
            frames = np.arange(played.frames)
            exported = np.stack([played.displacement(frame) for frame in frames])
            replayed = displacements(run, "latent", name)(frames, slice(None))
            U, q = played.reduced("glTF")
            columns = (q @ U.T).reshape(exported.shape)
            for shown in (exported, replayed, columns):
                off = np.linalg.norm(shown - full, axis=2).mean(axis=1)
                np.testing.assert_allclose(off, errors, rtol=1e-3)
            thin = played.thinned(2)
            np.testing.assert_array_equal(thin.displacement(1), exported[3])
            U, q = thin.reduced("USD")
            np.testing.assert_allclose(q[1] @ U.T, exported[3].ravel(), atol=1e-5 * np.abs(exported).max())
