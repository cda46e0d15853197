"""What cubature.py measures, part by part: quality, methods, online, scaling. Fitted rules are kept."""

from __future__ import annotations

import itertools
import resource
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from ldsim.cubature.choose import PoseSplit, choose_on_mesh, split_poses
from ldsim.cubature.methods import METHODS
from ldsim.cubature.options import FitOptions, TermOptions
from ldsim.cubature.path import residuals
from ldsim.cubature.rule import CubatureRule
from ldsim.cubature.samples import perturbed, pose_scales
from ldsim.cubature.terms import ForceTerm
from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.stepper import ReducedStepper
from reproduction.bench.cubature_models import Model
from reproduction.bench.kept import kept, kept_rules
from reproduction.harness import Row, row
from reproduction.reduced_runs import online_error, played, reference
from reproduction.rivals.every_element import EveryElement

Array = NDArray[np.float64]

# Most points: the error that the goal asks for on held-out poses, and the one on fitted poses to stop at.
GOALS = {100: (0.05, 0.015), 300: (0.01, 0.003)}
NO_STOP = 1e-3
NORMS = ("force", "compliance")
# Sizes in the table of methods, and of the rules that are stepped.
SIZES = (5, 10, 15, 20, 30, 40, 50, 60, 80, 100, 150)
STEPPED = (30, 50, 100, 300)
# Of the true poses in the target, as the configurations of x, beam and demo have it.
CLOSURE = 0.3
STEPS = ReducedOptions(tolerance=1e-7)


@dataclass(frozen=True)
class Effort:
    """How much to measure.

    Attributes:
        poses: fitted, at most two thirds of all. kept_back: of the training motions, to judge.
        frames: of a motion that are stepped, None for all.
    """

    poses: int = 400
    kept_back: int = 200
    most: tuple[int, ...] = (100, 300)
    method_points: int = 150
    frames: int | None = None


QUICK = Effort(150, 60, (100,), 60, 60)

# What a rule is fitted to, by the name that tables have for it.
FITS = {
    "latent-aware": FitOptions(norm="force"),
    "compliance norm": FitOptions(),
    "linear-space": FitOptions(norm="force", project="linear"),
    "closure": FitOptions(terms=TermOptions(closure=CLOSURE)),
}
STEPPED_FITS = tuple(FITS)
FITS |= {f"method {method}": FitOptions.model_validate({"method": method, "norm": "force"}) for method in METHODS}


def split(model: Model, effort: Effort) -> PoseSplit:
    """The poses that are fitted, and those kept back."""
    count = len(model.poses.z)
    fitted = min(effort.poses, 2 * count // 3)
    return PoseSplit(*split_poses(count, fitted, min(effort.kept_back, count - fitted), seed=0), recorded=count)


def largest(rules: Sequence[CubatureRule], most: int) -> CubatureRule:
    """The largest rule of at most so many points, the best of these on the fitted poses."""
    return max((rule for rule in rules if len(rule.points) <= most), key=lambda rule: len(rule.points))


@dataclass(frozen=True, eq=False)
class Fitted:
    """What takes long, kept in `folder` once it is there: paths of fits, motions stepped with every element."""

    model: Model
    effort: Effort
    folder: Path

    def rules(self, fit: str, most: int) -> list[CubatureRule]:
        """Those of a fit of at most `most` points."""
        options = FITS[fit].replace(tolerance=GOALS[most][1] if most in GOALS else NO_STOP, max_points=most)
        return kept_rules(
            self.folder / f"{self.model.name}-{fit.replace(' ', '_')}-{most}.npz",
            lambda: choose_on_mesh(self.model.poses, split(self.model, self.effort), options).rules,
        )

    def every_element(self, motion: str) -> float:
        """The online error of all quadrature points."""
        path = self.folder / f"{self.model.name}-every_element-{motion}.json"
        stepper = EveryElement(self.model.poses.space)
        return kept(path, lambda: motion_error(self.model, stepper, motion, self.effort.frames))


def judged(model: Model, effort: Effort, rules: list[CubatureRule]) -> Iterator[tuple[str, str, Array]]:
    """Errors of rules at decoded poses, none of which was fitted: which poses, which norm, the errors (l,)."""
    poses, kept_back = model.poses, split(model, effort).kept_back
    places = np.linspace(0, len(model.unseen) - 1, min(effort.kept_back, len(model.unseen))).astype(int)
    W = poses.compliance
    for name, z in {
        "held-out poses": poses.z[kept_back],
        "perturbed poses": perturbed(poses.z, kept_back, FitOptions().perturbation, (1,)),
        "held-out motion": model.unseen[places],
    }.items():
        forces = ForceTerm(poses, poses.samples(z, np.zeros(len(z), dtype=np.int64)))
        newtons = forces.scales[:, None]
        true = forces.target.reshape(len(newtons), -1) * newtons
        wrong = [residual.reshape(true.shape) * newtons for residual in residuals(forces, rules).T]
        for norm, metric in zip(NORMS, (np.eye(len(W)), W), strict=True):
            scales = pose_scales(np.linalg.norm(true @ metric, axis=1))[:, None]
            whole = float(np.linalg.norm(true @ metric / scales))
            yield name, norm, np.array([np.linalg.norm(part @ metric / scales) for part in wrong]) / whole


def quality(model: Model, effort: Effort, fitted: Fitted) -> list[Row]:
    """Errors on poses that were not fitted, of rules fitted in either norm, in both norms."""
    rows = [
        row(model.name, "cells", model.cells),
        row(model.name, "r", model.poses.decoder.r),
        row(model.name, "k", model.poses.decoder.k),
        row(model.name, "fitted poses", len(split(model, effort).fitted)),
    ]
    fits = ("latent-aware", "compliance norm")
    sets = {(fit, most): largest(fitted.rules(fit, most), most) for most in effort.most for fit in fits}
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
    sets = {method: fitted.rules(f"method {method}", effort.method_points) for method in METHODS}
    every = [largest(sets[method], size) for method in METHODS for size in sizes]
    place, norm, errors = next(judged(model, effort, every))
    for (method, size), entry, error in zip(itertools.product(METHODS, sizes), every, errors, strict=True):
        if len(entry.points) > size // 2:
            rows.append(row(model.name, f"error, {place}, {norm}, {method}, {size} points", float(error)))
    return rows


def online(model: Model, effort: Effort, fitted: Fitted) -> list[Row]:
    """Online error of rules against that of every element, on each motion of the run."""
    sizes = [size for size in STEPPED if size <= max(effort.most)]
    rows = []
    for motion in model.run.snapshots.names:
        label = f"{motion} ({model.run.recorded(motion).role})"
        whole = fitted.every_element(motion)
        rows.append(row(model.name, f"online error, every element, {label}", whole))
        for fit, size in itertools.product(STEPPED_FITS, sizes):
            most = min(most for most in effort.most if most >= size)
            if fit == "linear-space" and most > min(effort.most):
                continue
            rule = largest(fitted.rules(fit, most), size)
            stepper = ReducedStepper(model.poses.space.with_rule(rule), STEPS)
            value = motion_error(model, stepper, motion, effort.frames)
            print(f"  {model.name}: {fit}, {size} points, {label}: {value:.4f}, all {whole:.4f}", flush=True)
            goal = "<= 0.01" if fit == "latent-aware" and size in effort.most else None
            rows.append(row(model.name, f"online error, {fit}, {size} points, {label}", value))
            name = f"added to the online error, {fit}, {size} points, {label}"
            rows.append(row(model.name, name, value - whole, "", goal))
    return rows


def motion_error(model: Model, stepper: ReducedStepper | EveryElement, motion: str, frames: int | None) -> float:
    """Mean vertex distance over mean displacement of a motion, or of its first frames."""
    full = reference(model.run, motion, frames)
    with tqdm(total=full.motion.frames, desc=f"{model.name}, {motion}", unit="frame", disable=None) as bar:
        return online_error(played(stepper, full, progress=bar.update))


def scaling(model: Model, effort: Effort, fitted: Fitted) -> list[Row]:
    """Seconds of a fit with its judging, kernels compiled before; memory of the whole process so far."""
    chosen, options = split(model, effort), FITS["latent-aware"]
    small = PoseSplit(chosen.fitted[:4], chosen.kept_back[:4], chosen.recorded)
    choose_on_mesh(model.poses, small, options.replace(tolerance=0.5, max_points=4))
    rows = [row(model.name, "cells", model.cells), row(model.name, "fitted poses", len(chosen.fitted))]
    large = model.name == "dragon"
    for most in effort.most:
        started = time.perf_counter()
        choose_on_mesh(model.poses, chosen, options.replace(tolerance=GOALS[most][1], max_points=most))
        seconds = time.perf_counter() - started
        limit = f"<= {300 if large else 60}" if most == min(effort.most) else None
        rows.append(row(model.name, f"cubature, at most {most} points", seconds, "s", limit))
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 2**30
    return [*rows, row(model.name, "peak memory", memory, "GiB", "<= 12" if large else None)]


Part = Callable[[Model, Effort, Fitted], list[Row]]
PARTS: dict[str, Part] = {"quality": quality, "methods": methods, "online": online, "scaling": scaling}
