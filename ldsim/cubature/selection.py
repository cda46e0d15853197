"""Which poses the cubature is fitted to, which are kept back to judge it, and the fit of one space."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ldsim.cubature.fit import fit
from ldsim.cubature.forces import Closure, ProjectedForces
from ldsim.cubature.goal import Goal
from ldsim.cubature.ladder import CubatureFit, Progress, relative_errors
from ldsim.cubature.metric import rest_compliance
from ldsim.cubature.rows import Energies, ForceChanges, Rows
from ldsim.errors import SolverError
from ldsim.mechanics.scene import Scene
from ldsim.space.decoder import Decoder

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

# Length of the steps that the tangent is taken over, as a share of the standard deviation of the poses.
TANGENT_STEP = 0.02
# What each draw of random numbers is for: each has a stream of its own.
PERTURBED, TANGENTS, CANDIDATES, JUDGED = range(1, 5)


@dataclass(frozen=True)
class Recipe:
    """How the cubature of a space is fitted, as `settings.CubatureSettings` declares it.

    Attributes:
        method: a name of `fit.METHODS`.
        latent: project with the decoder's Jacobian; false for the space of U (An, Kim and James 2008).
        compliance: measure forces by the displacement energy they cause at rest (`metric.rest_compliance`).
        closure: share of the true poses' forces in the target.
        perturbed, perturbation: perturbed states as a share of the poses, and their distance from them in standard
            deviations of the poses.
        tangent, energy: weights of the tangent and of the energy rows relative to the forces; 0 leaves them out.
        candidates: most points looked at, drawn at random where there are more.
        threads: 0 for one a core.
    """

    goal: Goal
    method: str = "exchange"
    latent: bool = True
    compliance: bool = True
    closure: float = 0.0
    perturbed: float = 0.0
    perturbation: float = 0.1
    tangent: float = 0.0
    energy: float = 0.0
    candidates: int = 50_000
    threads: int = 0


@dataclass(frozen=True, eq=False)
class PoseSpace:
    """A space with the coordinates of all training poses.

    Attributes:
        U: basis, (3n, k), and beside it the fields of moving pins, (3n, k + l). stiffness: K̃₀ = UᵀK₀U, (k, k).
        z: coordinates of the poses, (N, r).
        displacement: the true displacement of pose t of them, (n, 3), metres; only read for a closure.
        given: what moving pins prescribe in the poses, (N, l); None where all stand still.
    """

    scene: Scene
    U: Array
    decoder: Decoder
    stiffness: Array
    z: Array
    displacement: Callable[[int], NDArray[np.floating]]
    given: Array | None = None

    def given_in(self, poses: Indices) -> Array | None:
        return None if self.given is None else self.given[poses]

    def in_basis(self) -> PoseSpace:
        """The same poses in the linear space of all of U."""
        return replace(self, decoder=Decoder.identity(self.decoder.k), z=self.decoder(self.z))


@dataclass(frozen=True, eq=False)
class Selection:
    """A fit with the errors of every set of its ladder, (l,), on poses kept back, and on perturbed states of these."""

    fit: CubatureFit
    heldout_errors: Array
    perturbed_errors: Array


def split_poses(frames: int, fitted: int, kept_back: int, seed: int) -> tuple[Indices, Indices]:
    """Two disjoint random choices of frames, each rising.

    Raises:
        SolverError: there are fewer frames than asked for.
    """
    if frames < fitted + kept_back:
        raise SolverError(
            f"cubature needs {fitted} poses to fit and {kept_back} to judge, but there are {frames} training frames; "
            "lower cubature.poses or cubature.heldout_poses, or record more"
        )
    order = np.random.default_rng(seed).permutation(frames)
    return np.sort(order[:fitted]), np.sort(order[fitted : fitted + kept_back])


def select(
    space: PoseSpace, fitted: Indices, kept_back: Indices, recipe: Recipe, progress: Progress | None = None
) -> Selection:
    """Fit to some poses and judge every set of the ladder on others.

    The error on held-out and perturbed poses is in the space that will be stepped, whatever the fit was projected on.
    A closure aims at the true poses where they are known: on held-out poses too, but not on perturbed ones.
    """
    found = _fit(space if recipe.latent else space.in_basis(), fitted, recipe, progress)
    heldout = _forces(space, space.z[kept_back], kept_back, recipe, _closure(space, kept_back, recipe))
    moved = perturb(space.z, kept_back, recipe.perturbation, (recipe.goal.seed, JUDGED))
    perturbed = _forces(space, moved, kept_back, recipe)
    return Selection(found, relative_errors(heldout, found.ladder), relative_errors(perturbed, found.ladder))


def perturb(z: Array, poses: Indices, size: float, seed: tuple[int, ...]) -> Array:
    """Some poses, each moved at random by `size` standard deviations of all poses, (T, r)."""
    steps = np.random.default_rng(seed).standard_normal((len(poses), z.shape[1]))
    moved: Array = z[poses] + size * steps * z.std(axis=0)
    return moved


def _fit(space: PoseSpace, fitted: Indices, recipe: Recipe, progress: Progress | None) -> CubatureFit:
    z, seed = space.z[fitted], recipe.goal.seed
    extra = np.random.default_rng((seed, PERTURBED)).permutation(fitted)[: round(recipe.perturbed * len(fitted))]
    every = np.concatenate([z, perturb(space.z, extra, recipe.perturbation, (seed, PERTURBED))])
    poses = np.concatenate([fitted, extra])
    candidates = _candidates(space.scene.points.n_points, recipe)
    forces = _forces(space, every, poses, recipe, _closure(space, fitted, recipe), candidates)
    others: list[tuple[Rows, float]] = []
    if recipe.tangent:
        steps = perturb(space.z, fitted, TANGENT_STEP, (seed, TANGENTS)) - z
        ahead_and_behind = np.concatenate([z + steps, z - steps])
        both = _forces(space, ahead_and_behind, np.tile(fitted, 2), recipe, None, candidates)
        others.append((ForceChanges(both, len(z)), recipe.tangent))
    if recipe.energy:
        given = space.given_in(poses)
        energies = Energies(space.scene, space.U, space.decoder, every, candidates, recipe.threads, given)
        others.append((energies, recipe.energy))
    return fit(forces, recipe.goal, recipe.method, others=tuple(others), candidates=candidates, progress=progress)


def _closure(space: PoseSpace, poses: Indices, recipe: Recipe) -> Closure | None:
    if not recipe.closure:
        return None
    return Closure(lambda t: space.displacement(int(poses[t])), len(poses), recipe.closure)


def _candidates(points: int, recipe: Recipe) -> Indices | None:
    if points <= recipe.candidates:
        return None
    rng = np.random.default_rng((recipe.goal.seed, CANDIDATES))
    return np.sort(rng.choice(points, recipe.candidates, replace=False))


def _forces(
    space: PoseSpace,
    z: Array,
    poses: Indices,
    recipe: Recipe,
    closure: Closure | None = None,
    candidates: Indices | None = None,
) -> ProjectedForces:
    """The forces at coordinates z, (T, r), with the pins as in some poses, (T,)."""
    return ProjectedForces(
        space.scene,
        space.U,
        space.decoder,
        z,
        given=space.given_in(poses),
        metric=rest_compliance(space.stiffness, space.decoder, space.z) if recipe.compliance else None,
        closure=closure,
        candidates=candidates,
        threads=recipe.threads,
    )
