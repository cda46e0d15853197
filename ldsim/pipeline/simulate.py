"""The stage `simulate`: the motions in the full, the latent and linear spaces of several sizes, timed and compared."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ldsim.arrays import Array
from ldsim.artefacts.records import write_simulation
from ldsim.dynamics.trajectory import LARGE_ONLINE_ERROR, Trajectory
from ldsim.errors import SettingsError
from ldsim.jit import one_thread
from ldsim.mechanics.scene import Scene, properties_of, with_properties
from ldsim.optimise.solution import failures
from ldsim.pipeline.choice_of_space import LATENT, chosen_space, judging, standings
from ldsim.pipeline.comparison import Measured, Reference, compare_motion, residuals
from ldsim.pipeline.options import SimulateOptions, SnapshotOptions
from ldsim.pipeline.progress import SILENT, Progress
from ldsim.pipeline.statement import BEFORE, LEFT_OUT, about, bound, fresh_errors, judged_before, left_out, sentence
from ldsim.run import AUTO, REDUCED, Run
from ldsim.space.novelty import Novelty
from ldsim.space.space import Space

Trajectories = dict[str, dict[str, Trajectory]]


def simulate(
    run: Run,
    options: SimulateOptions = SimulateOptions(),
    progress: Progress = SILENT,
    how: SnapshotOptions | None = None,
) -> Trajectories:
    """Run the motions in all spaces and write simulation.h5; space → motion → what was run.

    Args:
        how: whose `workers` and `linear_solver` hold for the full-space runs of fresh motions; as usual where left out.

    Raises:
        SettingsError: a motion is not known.
        ArtefactError: what is needed is missing or stale, or the artefact cannot be written.
    """
    stage = run.stage("simulate", options)
    read = ("scene", "snapshots", *(("tests",) if run.path("tests").is_file() else ()), "basis", "model", "cubature")
    run.require(*read)
    snapshots, changed = run.played, options.material is not None
    spaces = _spaces(run, options)
    names = _known(options.motions, snapshots.names)
    runs: Trajectories = {name: {} for name in ("full", *(space.name for space in spaces))}
    notes: dict[str, str | float | int] = {f"{space.name}_points": len(space.rule.points) for space in spaces}
    full_tolerance, tolerance = options.stops(run.scene.vertex_mass)
    reduced = run.reduced_options.replace(tolerance=tolerance, max_iterations=options.max_iterations)
    measured = _measured(options, full_tolerance)
    steps = sum((1 if changed else 2) * len(spaces) * snapshots.frames(name) for name in names)
    fresh = {}  # first: their full-space runs are kept if this is interrupted, comparisons are not
    if options.statement is not None and not changed:
        with one_thread():
            rivals = [space for space in spaces if space.name in REDUCED]
            fresh = fresh_errors(run, rivals, options.statement, reduced, progress, how)
    with one_thread(), progress.bar("simulate", steps, "step") as bar:
        for name in names:
            bar.say(name)
            recorded = run.recorded(name)
            reference = Reference(recorded.motion, recorded.held, None if changed else snapshots.reader(name))
            compared = compare_motion(spaces, reference, reduced, measured, bar.update)
            for space, trajectory, minimiser in compared:
                runs[space][name] = _with_novelty(trajectory, run.model.novelty)
                notes[f"{space}_minimiser"] = minimiser
    if fresh:
        notes |= {BEFORE: int(judged_before(run, run.hash("model"))), LEFT_OUT: left_out(run)}
    notes |= {"space": _space(run, runs, options), "material_changed": int(changed)}
    header = stage.header("simulation", read, -1, **notes)
    write_simulation(run.path("simulation"), header, runs, fresh)
    run.written("simulation")
    if options.statement is not None and fresh:
        said = bound(fresh["latent"], options.statement.quantile, options.statement.confidence)
        named = "" if notes["space"] == LATENT else LATENT
        progress.tell(sentence(said, about(options.statement), bool(notes[BEFORE]), int(notes[LEFT_OUT]), named))
    for warning in _failed_steps(runs):
        progress.tell(f"warning: {warning}")
    for name, words in novel_frames(runs["latent"], run.model.novelty).items():
        progress.tell(f"warning: {name} in the latent space: {words}")
    return runs


def _spaces(run: Run, options: SimulateOptions) -> list[Space]:
    """The reduced spaces, with the rules and the material that are asked for."""
    scene = _scene(run, options)
    points = {"linear": options.linear_points, "latent": options.points}
    linear = sorted((name for name in run.cubature if name not in points), key=lambda name: int(name.split("_")[1]))
    return [run.space(name, points.get(name), scene) for name in ("linear", "latent", *linear)]


def _scene(run: Run, options: SimulateOptions) -> Scene | None:
    """The solid with another material, where one is asked for."""
    if options.material is None:
        return None
    return with_properties(run.scene, properties_of(run.scene).changed(**options.material.model_dump()))


def simulated_scene(run: Run) -> Scene:
    """The solid as the reduced spaces were run, with another material where one was asked for."""
    return _scene(run, SimulateOptions.of_dump(run.header("simulation").settings)) or run.scene


def residual(run: Run, space: str, motion: str) -> Callable[[int, Array], Array] | None:
    """The function (frame, q) → what weight and grabs move beside U q in a motion that was run, (n, 3) metres.

    None in every space but a condensed one.
    """
    if space != "latent" or not run.model.condensed:
        return None
    options, recorded = SimulateOptions.of_dump(run.header("simulation").settings), run.recorded(motion)
    own = run.space(space, options.points, _scene(run, options))
    moved = residuals(own, Reference(recorded.motion, recorded.held, None))
    return lambda frame, q: moved(frame, q[None])[0]


def _measured(options: SimulateOptions, full_tolerance: float) -> Measured:
    given = options.minimiser
    if given is None:
        return Measured(options.full_frames, full_tolerance, options.window)
    return Measured(options.full_frames, full_tolerance, options.window, {given.method: given.model_dump()})


def _space(run: Run, runs: Trajectories, options: SimulateOptions) -> str:
    """The space to use from now on: as asked, or by error and time on the validation motions."""
    if options.space != AUTO:
        return options.space
    roles = {name: run.recorded(name).role for name in runs["latent"]}
    return chosen_space(standings(runs, judging(roles, ("validation", "train"))))


def _known(wanted: Sequence[str] | None, known: Sequence[str]) -> list[str]:
    unknown = [name for name in wanted or () if name not in known]
    if unknown:
        raise SettingsError(f"simulate.motions names {unknown[0]!r}; the snapshots hold {', '.join(known)}")
    return list(known if wanted is None else wanted)


def _with_novelty(trajectory: Trajectory, novelty: Novelty | None) -> Trajectory:
    if novelty is None or trajectory.latent is None:
        return trajectory
    return replace(trajectory, novelty=novelty(trajectory.latent))


def novel_frames(runs: Mapping[str, Trajectory], novelty: Novelty | None) -> dict[str, str]:
    """Motion → what is to be said where the latent space was among states that it does not know.

    The score knows places, not errors: of a motion that is known to be followed well nothing is said.
    """
    found: dict[str, str] = {}
    for name, trajectory in runs.items():
        error = trajectory.relative_error
        if novelty is None or trajectory.novelty is None or (error is not None and error <= LARGE_ONLINE_ERROR):
            continue
        far = int((trajectory.novelty > novelty.threshold).sum())
        if far:
            found[name] = (
                f"{far} of {len(trajectory.novelty)} frames are far from the training motions (score up to "
                f"{np.nanmax(trajectory.novelty):.2g}, threshold {novelty.threshold:.2g}); train on motions like it"
            )
    return found


def _failed_steps(runs: Mapping[str, Mapping[str, Trajectory]]) -> list[str]:
    found = {
        f"{name} in the {space} space": "it diverged" if trajectory.diverged else failures(trajectory.reason)
        for space, motions in runs.items()
        for name, trajectory in motions.items()
    }
    return [f"{where}: {words}" for where, words in found.items() if words]
