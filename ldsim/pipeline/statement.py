"""A statement that holds: how far the model is off on random motions that nothing has seen.

The bound is an order statistic, so that it supposes nothing of how the errors are distributed but that the motions are
drawn alike and independently (Wilks 1941, "Determination of sample sizes for setting tolerance limits").
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import binom

from ldsim.arrays import Array
from ldsim.artefacts.partial import MotionStore, StoredBefore, write_snapshots
from ldsim.artefacts.snapshots import Snapshots
from ldsim.artefacts.store import read_header, reading
from ldsim.dynamics.full.linear_choice import choose
from ldsim.dynamics.full.options import FullOptions
from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.errors import LostMotionError, SolverError
from ldsim.mechanics.motion import Motion
from ldsim.mechanics.random_pulls import surface_pulls
from ldsim.mechanics.scene import Scene
from ldsim.pipeline.comparison import Reference, run_reduced, with_errors
from ldsim.pipeline.ensemble import run_identity, run_motions
from ldsim.pipeline.options import SnapshotOptions, StatementOptions
from ldsim.pipeline.progress import Progress
from ldsim.run import Run
from ldsim.space.lifting import Lifting
from ldsim.space.space import Space

# Notes of the header of fresh.h5: how it was solved, which model was there then, how many motions the full space lost.
SOLVER, FIRST, LOST = "solver", "first_model", "lost"
# Notes of the header of simulation.h5: whether the fresh motions judged an earlier model too, and how many the full
# space lost.
BEFORE, LEFT_OUT = "fresh_before", "fresh_left_out"


@dataclass(frozen=True)
class Bound:
    """With this confidence, this share of motions drawn like those that were tried has no larger error.

    Attributes:
        error: infinite where too many were lost.
        motions: that were tried.
    """

    quantile: float
    confidence: float
    error: float
    motions: int


def bound(errors: Array, quantile: float, confidence: float) -> Bound:
    """The least of the errors that at least a quantile of all motions stays within, with some confidence.

    The k-th smallest of n covers the quantile q with the probability that fewer than k of n fall below that, P(B(n, q)
    < k). Where n are too few for the quantile that is asked for, the largest of them covers a smaller one, (1 −
    c)^(1/n), and that is told.

    Args:
        errors: of motions drawn alike and independently, (n,); infinite where one was lost.
    """
    n, ordered = len(errors), np.sort(np.where(np.isnan(errors), np.inf, errors))
    sure = binom.cdf(np.arange(n), n, quantile) >= confidence
    if sure.any():
        return Bound(quantile, confidence, float(ordered[int(sure.argmax())]), n)
    return Bound((1 - confidence) ** (1 / n), confidence, float(ordered[-1]), n)


def fresh_motions(scene: Scene, options: StatementOptions) -> list[Motion]:
    """Motions drawn independently of each other, each from rest: its own seed, and so its own places and directions."""
    seeds = np.random.SeedSequence(options.pulls.seed).generate_state(options.motions)
    return [surface_pulls(f"fresh_{i}", scene, options.pulls.replace(seed=int(seed))) for i, seed in enumerate(seeds)]


def fresh_errors(
    run: Run,
    spaces: Sequence[Space],
    options: StatementOptions,
    reduced: ReducedOptions,
    progress: Progress,
    how: SnapshotOptions | None = None,
) -> dict[str, Array]:
    """Space → the online error of each fresh motion, (n,), infinite where it was lost.

    Their full-space runs are kept beside the run, in fresh.h5, as long as solid, motions and solver stay the same. One
    that the full space itself loses has nothing to be compared with, and is left out: what is said is of the others.

    Args:
        how: how many run side by side, and how their linear systems are solved; as usual where it is left out.

    Raises:
        SolverError: the full space lost all of them.
    """
    _run_fresh(run, options, progress, how, run.hash("model"))
    errors: dict[str, list[float]] = {space.name: [] for space in spaces}
    with Snapshots(run.path("fresh"), kind="tests") as snapshots:
        with progress.bar("simulate: fresh motions", len(snapshots.names) * len(spaces), "motion") as bar:
            for name in snapshots.names:
                found = snapshots.recorded(name)
                reference = Reference(found.motion, found.held, snapshots.reader(name))
                lifting = Lifting.of(run.scene, [found.motion])
                for space in (space.with_lifting(lifting) for space in spaces):
                    trajectory = run_reduced(ReducedStepper(space, reduced), reference)
                    error = with_errors(trajectory, space, reference).relative_error
                    errors[space.name].append(math.inf if error is None or math.isnan(error) else error)
                    bar.update()
    return {name: np.array(values) for name, values in errors.items()}


def _run_fresh(
    run: Run, options: StatementOptions, progress: Progress, how: SnapshotOptions | None = None, model: str = ""
) -> None:
    """The fresh motions in the full space, interrupted and gone on with like any others.

    Args:
        model: hash of the one that they are to judge; the first one is noted beside them.
    """
    stage, path, folder = run.stage("snapshot", options), run.path("fresh"), run.folder / "fresh.partial"
    own = StatementOptions(motions=options.motions, pulls=options.pulls).dump()
    snapshots = SnapshotOptions.of_dump(run.header("snapshots").settings)  # with the usual workers and linear solver
    solver, how = snapshots.solver.replace(linear_solver="auto"), snapshots if how is None else how
    first = model
    if path.is_file():
        with reading(path, "tests") as file:
            header = read_header(file)
        first = str(header.notes.get(FIRST, first))
        same = header.settings == own and header.inputs == {"scene": run.hash("scene")}
        # those of earlier versions have the usual solver, and say no more than this
        usual = FullOptions(quasistatic=bool(header.notes.get("quasistatic", 0)))
        if same and header.notes.get(SOLVER, usual.model_dump_json()) == solver.model_dump_json():
            return
    motions = fresh_motions(run.scene, options)
    workers = min(how.workers, len(motions))
    chosen = solver.replace(linear_solver=choose(run.scene, how.linear_solver, workers).name)
    with ExitStack() as stack:
        there = stack.enter_context(Snapshots(path, kind="tests")) if path.is_file() else None
        ran = {} if there is None else {name: there.recorded(name).identity for name in there.names}
        scene_hash = run.hash("scene")
        kept = {
            each.name: StoredBefore(there, each.name)
            for each in motions
            if there is not None and ran.get(each.name) == run_identity(scene_hash, each, chosen)
        }
        missing = [each for each in motions if each.name not in kept]  # who asks for more waits for those alone
        with progress.bar("simulate: fresh motions, full space", sum(each.frames for each in missing), "frame") as bar:

            def show(done: int, unfinished: int) -> None:
                bar.say(f"{unfinished} motions to finish")
                bar.reach(done)

            try:
                lost = run_motions(run.path("scene"), folder, missing, chosen, workers, show, going_on=True)
            except SolverError as error:
                raise type(error)(f"simulate.statement, fresh {error}") from error
        if len(lost) == len(motions):
            raise LostMotionError(f"simulate.statement, every fresh motion is lost: {next(iter(lost.values()))}")
        if lost:
            which = f"the full space loses {len(lost)} of {len(motions)} fresh motions"
            progress.tell(f"note: {which}, which are left out of what is stated: {next(iter(lost.values()))}")
        for each in (each for each in motions if each.name in lost):
            MotionStore(folder, each).remove()
        motions = [each for each in motions if each.name not in lost]
        notes: dict[str, str | float | int] = {SOLVER: solver.model_dump_json(), FIRST: first if kept else model}
        notes[LOST] = len(lost)
        header = replace(stage.header("tests", ("scene",), options.pulls.seed, **notes), settings=own)
        stores = [(kept.get(each.name) or MotionStore(folder, each), each, "test") for each in motions]
        write_snapshots(path, header, stores, run.scene.mesh.n_vertices)


def judged_before(run: Run, model: str) -> bool:
    """Whether the fresh motions of a run have judged an earlier model than that of this hash."""
    with reading(run.path("fresh"), "tests") as file:
        return read_header(file).notes.get(FIRST, model) != model


def left_out(run: Run) -> int:
    """How many fresh motions of a run the full space lost."""
    with reading(run.path("fresh"), "tests") as file:
        return int(read_header(file).notes.get(LOST, 0))


def about(options: StatementOptions) -> str:
    """What the motions are that a statement is about."""
    pulls = options.pulls
    many = "one pull" if pulls.count == 1 else f"{pulls.count} pulls"
    return (
        f"{many} from rest anywhere on its surface, in any direction, by {400 * pulls.reach:.3g} to "
        f"{1000 * pulls.reach:.3g} mm with a spring of {pulls.stiffness:.3g} N/m"
    )


def sentence(found: Bound, what: str, before: bool = False, lost: int = 0, space: str = "") -> str:
    """The statement in words; `what` the motions are, see `about`, and whether they judged an earlier model too.

    Args:
        lost: how many more the full space lost.
        space: named where it is not the one that is used.
    """
    within = f" in the {space} space" if space else ""
    share = f"{100 * found.quantile:.3g} % of motions like these"
    seen = "that judged an earlier model too" if before else "that nothing had seen"
    others = f"; the full space itself lost {lost} more, which are left out" if lost else ""
    with_ = f"with {100 * found.confidence:.3g} % confidence, from {found.motions} fresh ones {seen}{others}"
    if not math.isfinite(found.error):
        return f"Nothing can be said of {share}{within}: too many of {found.motions} fresh ones were lost ({what})."
    return f"{share} stay within {100 * found.error:.3g} % of the full space{within} ({with_}; {what})."
