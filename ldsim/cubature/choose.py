"""The choice of the rules of one space: which poses, the fit on the mesh, closure and virtual points by their judge."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ldsim.arrays import Array, Indices
from ldsim.cubature.methods import fit
from ldsim.cubature.options import CubatureOptions, FitOptions, VirtualOptions
from ldsim.cubature.path import RulePath, Tell, VirtualFit, relative_errors
from ldsim.cubature.rule import CubatureRule
from ldsim.cubature.samples import PoseSpace, Samples, perturbed
from ldsim.cubature.system import System
from ldsim.cubature.terms import ForceTerm
from ldsim.cubature.virtual import Targets, fit_virtual, virtual_error
from ldsim.errors import SolverError
from ldsim.jit import in_threads

Judge = Callable[[CubatureRule], float]

# What each draw of random numbers is for: each has a stream of its own. Other numbers give other rules.
CANDIDATES, JUDGED = 3, 4
# Near states lie this far from their poses, in standard deviations of all poses, evenly on a logarithmic scale.
NEAREST, FARTHEST = 0.03, 0.3
# Share of the poses that only choose among what the fit of virtual points has seen.
ASIDE = 0.05
# Closures judged within this factor of the best are equally good, and the largest of them is taken: the true forces are
# right on other motions too.
TIE = 1.1


@dataclass(frozen=True, eq=False)
class PoseSplit:
    """Which of the poses are fitted, and which judge.

    Attributes:
        fitted: by the rules on the mesh, (T,), ascending. Virtual points are fitted to all but those kept back.
        kept_back: seen by no fit, (T,), ascending.
        recorded: the first so many of all poses are of recordings, the others of synthetic motions.
        seed: of what is drawn for virtual points.
    """

    fitted: Indices
    kept_back: Indices
    recorded: int
    seed: int = 0

    @classmethod
    def of(cls, poses: int, recorded: int, options: CubatureOptions) -> PoseSplit:
        """At random; of fewer poses than the options name, shares as large. See `split_poses`."""
        share = min(poses / (options.poses + options.heldout_poses), 1.0)
        fitted, kept_back = (max(int(share * most), 1) for most in (options.poses, options.heldout_poses))
        return cls(*split_poses(poses, fitted, kept_back, options.seed), recorded, options.seed)


def split_poses(frames: int, fitted: int, kept_back: int, seed: int) -> tuple[Indices, Indices]:
    """Two disjoint random choices of frames, each ascending.

    Raises:
        SolverError: there are fewer frames than asked for.
    """
    if frames < fitted + kept_back:
        raise SolverError(
            f"cubature needs {fitted} poses to fit and {kept_back} to judge, but there are {frames} training frames; "
            "record more"
        )
    order = np.random.default_rng(seed).permutation(frames)
    return np.sort(order[:fitted]), np.sort(order[fitted : fitted + kept_back])


def choose_on_mesh(space: PoseSpace, split: PoseSplit, options: FitOptions, tell: Tell | None = None) -> RulePath:
    """Rules of every size fitted to some poses, each judged on those kept back and on perturbed states of these.

    They are judged in the space that will be stepped, whatever the fit was projected on. A closure moves the forces of
    the poses kept back too, but not those of perturbed states, whose true selves nobody knows.

    Args:
        tell: told the number of points and the relative error after each change.
    """
    path = fit(_system(space if options.project == "latent" else space.linear(), split.fitted, options), options, tell)
    kept_back, metric = split.kept_back, _metric(space, options)
    moved = perturbed(space.z, kept_back, options.perturbation, (options.seed, JUDGED))
    heldout = relative_errors(ForceTerm(space, closed_samples(space, kept_back, options), metric), path.rules)
    near = relative_errors(ForceTerm(space, space.samples(moved, kept_back), metric), path.rules)
    errors = zip(path.rules, heldout, near, strict=True)
    rules = tuple(replace(rule, heldout_error=float(a), perturbed_error=float(b)) for rule, a, b in errors)
    return replace(path, rules=rules)


def _system(space: PoseSpace, fitted: Indices, options: FitOptions) -> System:
    """The forces of the fitted poses, and the volume."""
    samples, candidates = closed_samples(space, fitted, options), drawn_candidates(space.scene.points.n_points, options)
    return System(ForceTerm(space, samples, _metric(space, options), candidates), options.terms.volume, candidates)


def _metric(space: PoseSpace, options: FitOptions) -> Array | None:
    return space.compliance if options.norm == "compliance" else None


def closed_samples(space: PoseSpace, poses: Indices, options: FitOptions) -> Samples:
    """Some poses, their forces between those of the decoded and of the true ones.

    As the shares of the points stay those of the decoded poses, this is the same as fitting both with the weights
    1 − closure and closure.
    """
    closure, samples = options.terms.closure, space.samples(space.z[poses], poses)
    return samples.plus(closure * (space.true_forces(poses) - samples.forces)) if closure else samples


def drawn_candidates(points: int, options: FitOptions) -> Indices | None:
    """The points that a fit looks at, ascending; None for all where there are few enough."""
    if points <= options.candidates:
        return None
    rng = np.random.default_rng((options.seed, CANDIDATES))
    return np.sort(rng.choice(points, options.candidates, replace=False))


def choose_virtual(
    space: PoseSpace,
    path: RulePath,
    split: PoseSplit,
    options: VirtualOptions,
    judge: Judge | None = None,
    tell: Tell | None = None,
) -> VirtualFit:
    """Virtual points that start as the largest rule of a path with at most so many points.

    Whether the forces of the true poses help depends on the autoencoder: where they are a smooth function of z they
    take out its stiffness, where they are mostly noise of the training they spoil the fit. So each closure is tried,
    and of those that the judge finds best or nearly so the largest is taken.

    Args:
        judge: the error of a rule where it is to be used; None takes the first closure.
        tell: told the step and the error on the states put aside, a few times for each closure.

    Raises:
        SolverError: no two poses are left to fit, or none has finite energy.
    """
    start = path.at_most(options.points)
    chosen, aside = virtual_poses(len(space.z), split, options.poses)
    fitted, put_aside = (ClosedSamples.of(space, p, (split.seed, i)) for i, p in enumerate((chosen, aside)))
    closures = options.closures if judge is not None else options.closures[:1]
    reached = dict.fromkeys(closures, 0)

    def with_closure(closure: float) -> CubatureRule:
        def told(step: int, error: float) -> None:
            reached[closure] = step
            if tell is not None:
                tell(sum(reached.values()), error)

        targets = [Targets.joined(*samples.targets(space, start, closure)) for samples in (fitted, put_aside)]
        return fit_virtual(space, start, (targets[0], targets[1]), options, split.seed, told)

    found = zip(closures, in_threads(with_closure, closures, space.threads), strict=True)
    tried = {closure: (np.nan if judge is None else judge(rule), rule) for closure, rule in found}
    least = min(error for error, _ in tried.values())
    closure = max(share for share, (error, _) in tried.items() if not error > TIE * least)
    on_mesh = np.nan if judge is None else judge(path.best)
    judged = np.array([[np.nan, on_mesh], *([share, error] for share, (error, _) in tried.items())])
    kept_back = ClosedSamples.of(space, split.kept_back, (split.seed, 2)).targets(space, start, closure)
    rule = tried[closure][1]
    heldout, near = (virtual_error(space, rule, targets) for targets in kept_back)
    return VirtualFit(replace(rule, heldout_error=heldout, perturbed_error=near), closure, judged)


def virtual_poses(poses: int, split: PoseSplit, most: int) -> tuple[Indices, Indices]:
    """At most so many poses to fit, and others to choose among what the fit has seen, of all but those kept back.

    Where there are synthetic poses, recorded ones are as many, if need be several times: each time with another near
    state.

    Raises:
        SolverError: no two poses are left.
    """
    others = np.random.default_rng(split.seed).permutation(np.setdiff1d(np.arange(poses), split.kept_back))
    if len(others) < 2:
        raise SolverError(f"virtual points need two poses besides those kept back; there are {len(others)}")
    aside = np.zeros(poses, dtype=bool)
    aside[others[: max(round(ASIDE * len(others)), 1)]] = True
    chosen = []
    for left, count in ((others[~aside[others]], most), (others[aside[others]], round(ASIDE * most))):
        first, rest = left[left < split.recorded], left[left >= split.recorded]
        half = np.resize(first, max(count // 2, 1)) if len(first) and len(rest) else first[:count]
        chosen.append(np.concatenate([half, rest[: max(count - len(half), 1)]]))
    return chosen[0], chosen[1]


@dataclass(frozen=True, eq=False)
class ClosedSamples:
    """Poses and a near state of each, whose forces a closure can move.

    The latent pose û = U φ(z) of a true pose u is a little off, and in a stiff solid its forces are off by much more:
    the latent solid then rests and swings elsewhere. Where the closure is 1, the force at z is to be the true one,
    J(z)ᵀ Uᵀ f(u), so that z is where the true solid would be, and what the reduction adds in stiffness goes. A near
    state z' keeps the difference of its pose: J(z')ᵀ Uᵀ (f(û') + f(u) − f(û)).

    Attributes:
        excess: Uᵀ (f(u) − f(û)), (T, k).
    """

    poses: Samples
    near: Samples
    excess: Array

    @classmethod
    def of(cls, space: PoseSpace, poses: Indices, seed: tuple[int, ...]) -> ClosedSamples:
        """Some poses, and a near state of each drawn with a seed."""
        z, rng = space.z[poses], np.random.default_rng(seed)
        distance = np.exp(rng.uniform(np.log(NEAREST), np.log(FARTHEST), (len(z), 1)))
        near = z + distance * space.z.std(axis=0) * rng.standard_normal(z.shape)
        decoded = space.samples(z, poses)
        return cls(decoded, space.samples(near, poses), space.true_forces(poses) - decoded.forces)

    def targets(self, space: PoseSpace, start: CubatureRule, closure: float) -> tuple[Targets, Targets]:
        """What points that start at those of a rule are to have at the poses, and at the near states."""
        # with a closure of 0 a pose counts whose true self has infinite energy
        excess = closure * self.excess if closure else np.zeros_like(self.excess)
        poses, near = (Targets.of(space, samples.plus(excess), start.points) for samples in (self.poses, self.near))
        return poses, near
