"""What benchmarks/cubature.py measures, part by part: quality, methods, online, scaling. Fitted sets are kept."""

from __future__ import annotations

import itertools
import json
import resource
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from cubature_models import Model
from every_element import EveryElement, run
from numpy.typing import NDArray
from results_file import Row, row

from ldsim.cubature.fit import METHODS
from ldsim.cubature.forces import ProjectedForces, pose_scales
from ldsim.cubature.goal import Goal
from ldsim.cubature.ladder import residuals
from ldsim.cubature.metric import rest_compliance
from ldsim.cubature.rows import FLOOR
from ldsim.cubature.rule import CubatureRule
from ldsim.cubature.selection import Recipe, perturb, select, split_poses
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.pipeline.comparison import run_reduced, with_errors

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

# Most points: the error that the goal asks for on held-out poses, and the one on fitted poses to stop at.
GOALS = {100: (0.05, 0.015), 300: (0.01, 0.003)}
NO_STOP = 1e-3
NORMS = ("force", "compliance")
# Sizes in the table of methods, and of the sets that are stepped.
SIZES = (5, 10, 15, 20, 30, 40, 50, 60, 80, 100, 150)
STEPPED = (30, 50, 100, 300)
# Of the true poses in the target, as the configurations of x, beam and demo have it.
CLOSURE = 0.3
STOP = 1e-7


@dataclass(frozen=True)
class Effort:
    """How much to measure.

    Attributes:
        poses: fitted, at most two thirds of all. kept_back: of the training motions, to judge.
        perturbed: of the recipe. frames: of a motion that are stepped, None for all.
    """

    poses: int = 400
    kept_back: int = 200
    most: tuple[int, ...] = (100, 300)
    method_points: int = 150
    frames: int | None = None


QUICK = Effort(150, 60, (100,), 60, 60)

# What a set is fitted to, by the name that tables have for it.
FITS: dict[str, dict[str, Any]] = {
    "latent-aware": {"compliance": False},
    "compliance norm": {},
    "linear-space": {"compliance": False, "latent": False},
    "closure": {"closure": CLOSURE},
}
STEPPED_FITS = tuple(FITS)
FITS |= {f"method {method}": {"method": method, "compliance": False} for method in METHODS}


def poses(model: Model, effort: Effort) -> tuple[Indices, Indices]:
    """The frames that are fitted, and those kept back."""
    frames = len(model.space.z)
    fitted = min(effort.poses, 2 * frames // 3)
    return split_poses(frames, fitted, min(effort.kept_back, frames - fitted), seed=0)


def largest(ladder: tuple[CubatureRule, ...], most: int) -> CubatureRule:
    """The largest set of at most so many points, the best of these on the fitted poses."""
    return max((entry for entry in ladder if len(entry.points) <= most), key=lambda entry: len(entry.points))


@dataclass(frozen=True, eq=False)
class Fitted:
    """What takes long, kept in `folder` once it is there: ladders of fits, motions stepped with every element."""

    model: Model
    effort: Effort
    folder: Path

    def ladder(self, fit: str, most: int) -> tuple[CubatureRule, ...]:
        """The sets of a fit of at most `most` points."""
        path = self.folder / f"{self.model.name}-{fit.replace(' ', '_')}-{most}.npz"
        if not path.exists():
            stop = GOALS[most][1] if most in GOALS else NO_STOP
            recipe = Recipe(Goal(stop, most), **FITS[fit])
            print(f"  {self.model.name}: fitting {fit}, at most {most} points", flush=True)
            found = select(self.model.space, *poses(self.model, self.effort), recipe).fit.ladder
            arrays = {f"{name}_{i}": getattr(entry, name) for i, entry in enumerate(found) for name in vars(entry)}
            np.savez(path, **arrays)
        with np.load(path) as stored:
            return tuple(
                CubatureRule(stored[f"points_{i}"], stored[f"weights_{i}"], float(stored[f"training_error_{i}"]))
                for i in range(len(stored.files) // 3)
            )

    def every_element(self, motion: str) -> float:
        """The online error of all quadrature points."""
        path = self.folder / f"{self.model.name}-every_element-{motion}.json"
        if not path.exists():
            print(f"  {self.model.name}: stepping {motion} with every element", flush=True)
            path.write_text(json.dumps(every_element_error(self.model, motion, self.effort.frames)))
        return float(json.loads(path.read_text()))


def judged(model: Model, effort: Effort, sets: list[CubatureRule]) -> Iterator[tuple[str, str, Array]]:
    """Errors of sets at decoded poses, none of which was fitted: which poses, which norm, the errors (l,)."""
    space, (_, kept_back) = model.space, poses(model, effort)
    places = np.linspace(0, len(model.unseen) - 1, min(effort.kept_back, len(model.unseen))).astype(int)
    W = rest_compliance(space.stiffness, space.decoder, space.z)
    for name, z in {
        "held-out poses": space.z[kept_back],
        "perturbed poses": perturb(space.z, kept_back, Recipe.perturbation, (1,)),
        "held-out motion": model.unseen[places],
    }.items():
        forces = ProjectedForces(space.scene, space.U, space.decoder, z, threads=0)
        newtons = forces.scales[:, None]
        true = forces.target.reshape(len(newtons), -1) * newtons
        wrong = [residual.reshape(true.shape) * newtons for residual in residuals(forces, sets).T]
        for norm, metric in zip(NORMS, (np.eye(len(W)), W), strict=True):
            scales = pose_scales(np.linalg.norm(true @ metric, axis=1), FLOOR, 0.0)[:, None]
            whole = float(np.linalg.norm(true @ metric / scales))
            yield name, norm, np.array([np.linalg.norm(part @ metric / scales) for part in wrong]) / whole


def quality(model: Model, effort: Effort, fitted: Fitted) -> list[Row]:
    """Errors on poses that were not fitted, of sets fitted in either norm, in both norms."""
    rows = [
        row(model.name, "cells", model.cells),
        row(model.name, "r", model.space.decoder.r),
        row(model.name, "k", model.space.decoder.k),
        row(model.name, "fitted poses", len(poses(model, effort)[0])),
    ]
    fits = ("latent-aware", "compliance norm")
    sets = {(fit, most): largest(fitted.ladder(fit, most), most) for most in effort.most for fit in fits}
    rows += [
        row(model.name, f"points, {fit}, at most {most}", len(entry.points), "", f"<= {most}")
        for (fit, most), entry in sets.items()
    ]
    for place, norm, errors in judged(model, effort, list(sets.values())):
        for (fit, most), error in zip(sets, errors, strict=True):
            asked = place == "held-out poses" and (fit == "latent-aware") == (norm == "force")
            goal = f"<= {GOALS[most][0]}" if asked else None
            name = f"relative error, {place}, {norm}, {fit}, at most {most} points"
            rows.append(row(model.name, name, float(error), "", goal))
    return rows


def methods(model: Model, effort: Effort, fitted: Fitted) -> list[Row]:
    """Points against error of all methods on the same poses, fitted in the plain norm of the publications."""
    sizes, rows = [size for size in SIZES if size <= effort.method_points], []
    sets = {method: fitted.ladder(f"method {method}", effort.method_points) for method in METHODS}
    every = [largest(sets[method], size) for method in METHODS for size in sizes]
    place, norm, errors = next(judged(model, effort, every))
    for (method, size), entry, error in zip(itertools.product(METHODS, sizes), every, errors, strict=True):
        if len(entry.points) > size // 2:
            rows.append(row(model.name, f"error, {place}, {norm}, {method}, {size} points", float(error)))
    return rows


def online(model: Model, effort: Effort, fitted: Fitted) -> list[Row]:
    """Online error of sets against that of every element, on each motion of the run."""
    sizes = [size for size in STEPPED if size <= max(effort.most)]
    rows = []
    for motion in model.snapshots.names:
        label = f"{motion} ({model.snapshots.recorded(motion).role})"
        whole = fitted.every_element(motion)
        rows.append(row(model.name, f"online error, every element, {label}", whole))
        for fit, size in itertools.product(STEPPED_FITS, sizes):
            most = min(most for most in effort.most if most >= size)
            if fit == "linear-space" and most > min(effort.most):
                continue
            value = set_error(model, largest(fitted.ladder(fit, most), size), motion, effort.frames)
            print(f"  {model.name}: {fit}, {size} points, {label}: {value:.4f}, all {whole:.4f}", flush=True)
            goal = "<= 0.01" if fit == "latent-aware" and size in effort.most else None
            rows.append(row(model.name, f"online error, {fit}, {size} points, {label}", value))
            name = f"added to the online error, {fit}, {size} points, {label}"
            rows.append(row(model.name, name, value - whole, "", goal))
    return rows


def every_element_error(model: Model, motion: str, frames: int | None) -> float:
    """Mean vertex distance over mean displacement of a motion stepped with all quadrature points."""
    space, recorded = model.space, model.snapshots.recorded(motion)
    count = min(frames or recorded.motion.frames, recorded.motion.frames)
    stepper = EveryElement(space.scene, space.U, space.decoder)

    def progress(frame: int) -> None:
        if frame % 100 == 0:
            print(f"  {model.name}: every element on {motion}, frame {frame} of {count}", flush=True)

    q = run(stepper, recorded.motion, dict(recorded.held), count, progress=progress)
    read, distance, moved = model.snapshots.reader(motion), 0.0, 0.0
    for first in range(0, count, 64):
        u = read(first, min(first + 64, count)).astype(np.float64)
        decoded = (q[first : first + len(u)] @ space.U.T).reshape(u.shape)
        distance += float(np.linalg.norm(decoded - u, axis=2).sum())
        moved += float(np.linalg.norm(u, axis=2).sum())
    return distance / moved


def set_error(model: Model, points: CubatureRule, motion: str, frames: int | None) -> float:
    """The same with a cubature set, as `ldsim simulate` steps it."""
    space, recorded = model.space, model.snapshots.recorded(motion)
    stepper = ReducedStepper(space.scene, space.U, space.decoder, points, tolerance=STOP, current=True)
    count = min(frames or recorded.motion.frames, recorded.motion.frames)
    done = run_reduced(stepper, space.scene, recorded.motion, recorded.held, range(count))
    done = with_errors(done, space.U, model.snapshots.reader(motion), done)
    assert done.mean_error is not None and done.mean_displacement is not None
    return float(done.mean_error.sum() / done.mean_displacement.sum())


def scaling(model: Model, effort: Effort, fitted: Fitted) -> list[Row]:
    """Seconds of a fit with its judging, kernels compiled before; memory of the whole process so far."""
    chosen, kept_back = poses(model, effort)
    select(model.space, chosen[:4], kept_back[:4], Recipe(Goal(0.5, 4), compliance=False))
    rows = [row(model.name, "cells", model.cells), row(model.name, "fitted poses", len(chosen))]
    large = model.name == "dragon"
    for most in effort.most:
        started = time.perf_counter()
        recipe = Recipe(Goal(GOALS[most][1], most), **FITS["latent-aware"])
        select(model.space, chosen, kept_back, recipe)
        seconds = time.perf_counter() - started
        limit = f"<= {300 if large else 60}" if most == min(effort.most) else None
        rows.append(row(model.name, f"cubature, at most {most} points", seconds, "s", limit))
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 2**30
    return [*rows, row(model.name, "peak memory", memory, "GiB", "<= 12" if large else None)]


Part = Callable[[Model, Effort, Fitted], list[Row]]
PARTS: dict[str, Part] = {"quality": quality, "methods": methods, "online": online, "scaling": scaling}
