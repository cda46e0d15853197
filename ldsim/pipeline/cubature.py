"""The stage cubature: rules of every size and virtual points for the latent space and its linear rival."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ldsim.arrays import Array
from ldsim.artefacts.records import write_cubature
from ldsim.cubature.choose import Judge, PoseSplit, choose_on_mesh, choose_virtual
from ldsim.cubature.options import CubatureOptions
from ldsim.cubature.path import RulePath, Tell, VirtualFit
from ldsim.cubature.rule import CubatureRule
from ldsim.cubature.samples import PoseSpace
from ldsim.dynamics.reduced.matrices import reduced_rest_stiffness
from ldsim.errors import SettingsError
from ldsim.jit import one_thread
from ldsim.pipeline.comparison import Reference, windowed_error
from ldsim.pipeline.progress import SILENT, Progress
from ldsim.run import Run, latent_space, linear_name
from ldsim.space.lifting import Lifting
from ldsim.space.projection import all_coordinates
from ldsim.space.space import Space

INPUTS = ("scene", "snapshots", "basis", "model")
# Seconds between restarts of the runs that virtual points are judged by.
WINDOW = 0.25
# Further fits where poses that were kept back miss the tolerance, and which share of it their error should then be.
REFITS, MARGIN = 2, 0.95


def cubature(
    run: Run, options: CubatureOptions = CubatureOptions(), progress: Progress = SILENT
) -> dict[str, RulePath]:
    """Choose the cubature rules of the latent space and of linear ones of several sizes, and write cubature.h5.

    All get the same: poses, method, virtual points, closures and their judge. A rule that misses the tolerance is
    written all the same, and a warning is told (`RulePath.meets`).

    Raises:
        ArtefactError: scene, snapshots, basis or model is missing, or they do not belong together.
        SolverError: there are fewer poses than asked for, or their energy is infinite.
    """
    with one_thread():  # all products: with more threads they are summed in another order
        return _cubature(run, options, progress)


def _cubature(run: Run, options: CubatureOptions, progress: Progress) -> dict[str, RulePath]:
    stage = run.stage("cubature", options)
    run.require(*INPUTS)
    poses = TrainingPoses(run, options.threads)
    split = PoseSplit.of(len(poses.q), poses.recorded, options)
    found: dict[str, RulePath] = {}
    seconds: dict[str, float] = {}
    kp = run.model.kp
    for k in (None, kp, *options.sizes(kp, run.basis.k)):
        space = poses.latent() if k is None else poses.linear(k)
        name = space.space.name
        started = time.perf_counter()
        own = options
        if k is not None:
            own = options.linear(len(found["latent"].best.points) if options.equal_points else None)
        with progress.bar(f"cubature {name}", None, "rule") as bar:

            def told(points: int, error: float) -> None:
                bar.say(f"{points} points, relative error {error:.3f}")
                bar.update()

            path = _chosen_on_mesh(space, split, own, told)
        if not path.meets(options.tolerance):
            progress.tell(_miss(name, path, options.replace(max_points=own.max_points)))
        found[name] = replace(path, virtual=_virtual(run, space, path, split, own, progress))
        seconds[f"{name}_seconds"] = time.perf_counter() - started
    header = stage.header("cubature", INPUTS, options.seed, **seconds)
    write_cubature(run.path("cubature"), header, found)
    run.written("cubature")
    return found


def _chosen_on_mesh(space: PoseSpace, split: PoseSplit, options: CubatureOptions, told: Tell) -> RulePath:
    """Rules that meet the tolerance on the poses kept back too, if need be by a fit to a smaller one.

    A method of others stops where it was published to stop.
    """
    path = choose_on_mesh(space, split, options, told)
    for _ in range(REFITS if options.method == "exchange" else 0):
        if path.meets(options.tolerance) or len(path.best.points) >= options.max_points:
            break
        smaller = MARGIN * options.tolerance * path.best.training_error / path.best.heldout_error
        path = choose_on_mesh(space, split, options.replace(tolerance=smaller), told)
    return path


class TrainingPoses:
    """All training poses of a run: those of the snapshots and after them those of synthetic motions.

    Attributes:
        q: their coordinates in all columns of the basis, (N, k).
        recorded: how many are of snapshots.
    """

    def __init__(self, run: Run, threads: int) -> None:
        self._run, self._threads = run, threads
        names = run.snapshots.with_role("train")
        motions = [run.recorded(name).motion for name in names]
        self._lifting = Lifting.of(run.scene, motions)
        self._read = run.snapshots.frame_reader(names)
        chunks = self._lifting.taken_off(lambda: run.snapshots.chunks(names), motions)
        self.q = all_coordinates(chunks, run.basis)
        self.recorded = len(self.q)
        if run.pca.synthetic is not None:
            self.q = np.concatenate([self.q, run.pca.synthetic])
        a = self._lifting.all_coordinates(motions)
        self._given = np.pad(a, ((0, len(self.q) - self.recorded), (0, 0)))  # pins stand still in synthetic motions
        self._stiffness = reduced_rest_stiffness(run.scene, run.basis)

    def latent(self) -> PoseSpace:
        """In the latent space."""
        run = self._run
        model, space = run.model, latent_space(run.scene, run.basis, run.model)
        if space.is_condensed:  # its coordinates are combinations of the basis' columns
            return self._space(space, self.q @ run.basis.project(space.reduced_basis.columns(space.r).matrix.T).T)
        return self._space(space, model.encoder(self.q))

    def linear(self, k: int) -> PoseSpace:
        """In the linear space of the first k columns."""
        space = Space.linear(self._run.scene, self._run.basis, k)
        return self._space(replace(space, name=linear_name(k, self._run.model.kp)), self.q[:, :k])

    def _space(self, space: Space, z: Array) -> PoseSpace:
        k, lifted = space.decoder.k, space.with_lifting(self._lifting)
        # a condensed space has a basis of its own
        stiffness = reduced_rest_stiffness(space.scene, space.reduced_basis) if space.is_condensed else self._stiffness
        stiffness = stiffness[:k, :k]
        return PoseSpace(lifted, stiffness, z, self._displacement, self._given, self._threads)

    def _displacement(self, t: int) -> NDArray[np.floating]:
        """Of a pose, (n, 3): as the full space had it, or, where it never was there, as the whole basis has it."""
        return self._read(t) if t < self.recorded else (self._run.basis.matrix @ self.q[t]).reshape(-1, 3)


def _virtual(
    run: Run,
    space: PoseSpace,
    path: RulePath,
    split: PoseSplit,
    options: CubatureOptions,
    progress: Progress,
) -> VirtualFit | None:
    """The virtual points of a space, where some are asked for and worth having."""
    asked, name = options.virtual, space.space.name
    if space.space.is_condensed:
        return _potential(run, space.space, path)
    if not asked.points:
        return None
    title, total = f"cubature {name}, virtual", asked.steps * len(asked.closures)
    with one_thread(), progress.bar(title, total, "step") as bar:
        bar.say("forces of the poses")

        def told(step: int, error: float) -> None:
            bar.say(f"relative error {error:.3f}")
            bar.reach(step)

        found = choose_virtual(space, path, split, asked, _judge(run, space.space), told)
    if not found.worse_than_mesh:
        return found
    errors = ", ".join(f"{error:.3g} with closure {share:g}" for share, error in found.judged[1:])
    progress.tell(
        f"note: no virtual points for the {name} space: on the motions that judge them they are off by {errors}, and "
        f"{len(path.best.points)} points of the mesh by {found.judged[0, 1]:.3g}"
    )
    return None


def _potential(run: Run, space: Space, path: RulePath) -> VirtualFit | None:
    """The points of V_eff(z), which the training has fitted, judged beside points of the mesh at decoded poses."""
    rule, judge = run.model.potential, _judge(run, space)
    assert rule is not None
    errors = [judge(path.best), judge(rule)]
    found = VirtualFit(rule, 1.0, np.array([[np.nan, errors[0]], [1.0, errors[1]]]))
    return None if found.worse_than_mesh else found


def _judge(run: Run, space: Space) -> Judge:
    """The windowed online error of a rule on the validation motions, without any on the training motions."""
    names, options = run.snapshots.with_role("validation") or run.snapshots.with_role("train"), run.reduced_options

    def judge(rule: CubatureRule) -> float:
        off = moved = 0.0
        for name in names:
            recorded = run.recorded(name)
            reference = Reference(recorded.motion, recorded.held, run.snapshots.reader(name))
            own = windowed_error(space.with_rule(rule), reference, WINDOW, options)
            off, moved = off + own[0], moved + own[1]
        if not moved:
            raise SettingsError(
                f"nothing moves in {', '.join(names)}, by which rules are judged; give a motion that does"
            )
        return off / moved

    return judge


def _miss(name: str, path: RulePath, options: CubatureOptions) -> str:
    best = path.best
    return (
        f"warning: the {name} cubature has a relative error of {best.training_error:.3f} on fitted poses and "
        f"{best.heldout_error:.3f} on poses kept back, with {len(best.points)} points; asked were "
        f"{options.tolerance:g} with at most {options.max_points}; it was written all the same"
    )


def summary(found: dict[str, RulePath]) -> str:
    """The sizes and errors of the rules of each space, in one line."""
    return "; ".join(_summary(name, path) for name, path in found.items())


def _summary(name: str, path: RulePath) -> str:
    told = f"{name}: {len(path.best.points)} points, {_errors(path.best)}"
    if path.virtual is not None:
        rule, closure = path.virtual.rule, path.virtual.closure
        told += f"; {len(rule.points)} virtual points, {_errors(rule)}, closure {closure:g}"
    return told


def _errors(rule: CubatureRule) -> str:
    errors = rule.training_error, rule.heldout_error, rule.perturbed_error
    return "relative error {:.3f}, kept back {:.3f}, perturbed {:.3f}".format(*errors)
