"""Virtual cubature points: points that are fitted, their strain maps as well as their weights.

A point of the mesh adds w Ψ(I + G q) to the potential, with the strain map G = ∂F/∂q that its place in the mesh
gives it. A model of r numbers needs no places, only a potential with the right gradient in z: here the entries of G
are free too, as if a point could lie anywhere and average over what is around it. Material, rest state (Ψ is least at
q = 0) and positive weights stay what they were, so the sum is still the energy of an elastic solid.

The fit is least squares over states of the training motions: Adam (Kingma and Ba 2015) on batches, from points of the
mesh, with the exact gradient

    ∂/∂G_s Σ_t ½ ‖A_tᵀ Σ_s w_s G_sᵀ P_s − τ_t‖² = Σ_t w_s (P_s y_tᵀ + (∂²Ψ/∂F² : G_s y_t) q_tᵀ),
    y_t = A_t (A_tᵀ Σ_s w_s G_sᵀ P_s − τ_t),

for A_t = J W / scale and the aim τ_t (`aims`). Hernández, Bravo and Ares de Parga 2023 ("CECM", arXiv
2308.03877) move points continuously through the mesh; strain maps that belong to no place are ours.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ldsim.cubature.aims import Aiming, Aims
from ldsim.cubature.kernels import point_stress_changes, stresses_of_strains
from ldsim.cubature.ladder import VirtualSelection
from ldsim.cubature.rule import CubatureRule
from ldsim.cubature.selection import PoseSpace
from ldsim.errors import SolverError
from ldsim.mechanics.elastic import Elements
from ldsim.mechanics.scene import Scene

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Progress = Callable[[int, float], None]
Judge = Callable[[CubatureRule], float]

# Adam: decays of both moments, the usual ones. A gradient longer than LONGEST is shortened to it.
FIRST, SECOND, TINY = 0.9, 0.999, 1e-8
LONGEST = 1.0
# The weights' logarithms move this many times as fast as the maps, in units of each map column's root mean square.
WEIGHTS_FASTER = 3.0
WARM_UP = 0.1
# Share of the poses that only choose among what the fit has seen.
ASIDE = 0.05
# How often the fit is judged on kept-back poses.
JUDGED = 20
STATES_AT_ONCE = 512
# The last points are taken unless their error is so many times the least.
SETTLED = 1.1
# Closures judged within this factor of the best are equally good, and the largest of them is taken: the true forces are
# right on other motions too.
TIE = 1.1


@dataclass(frozen=True)
class VirtualRecipe:
    """How virtual points are fitted, as `settings.VirtualSettings` declares it.

    Attributes:
        points: most of them; 0 for none.
        poses: at most so many are fitted, half of them recorded ones where others were rehearsed.
        closures: shares of the true poses' forces in the aims; each is tried.
        steps: of Adam. batch: states in each. rate: largest step, in root mean squares of a column of the maps.
        seed: of poses, perturbed states and batches. threads: for the aims, 0 for one a core.
    """

    points: int
    poses: int = 4000
    closures: tuple[float, ...] = (0.0, 1.0)
    steps: int = 5000
    batch: int = 256
    rate: float = 3e-3
    seed: int = 0
    threads: int = 0


def select_virtual(
    space: PoseSpace,
    ladder: tuple[CubatureRule, ...],
    kept_back: Indices,
    recorded: int,
    recipe: VirtualRecipe,
    judge: Judge | None = None,
    progress: Progress | None = None,
) -> VirtualSelection:
    """Fit virtual points that start as the largest set of a ladder with at most so many points.

    Whether the forces of the true poses help depends on the autoencoder: where they are a smooth function of z they
    take out its stiffness, where they are mostly noise of the training they spoil the fit. So each closure is tried,
    and of those that the judge finds best or nearly so the largest is taken.

    Args:
        kept_back: poses to measure the error on, seen by nothing else.
        recorded: the first so many poses are of recordings, the others rehearsed.
        judge: the error of a set where it is to be used; None takes the first closure.
        progress: told the step and the error on poses put aside, a few times for each closure.

    Raises:
        SolverError: no pose is left to fit, or none has finite energy.
    """
    start = largest(ladder, recipe.points)
    aiming = Aiming(space, start.points, recipe.threads)
    chosen, aside = choose_poses(len(space.z), kept_back, recorded, recipe)
    fitted, put_aside = aiming.forces(chosen, (recipe.seed, 0)), aiming.forces(aside, (recipe.seed, 1))
    U = np.ascontiguousarray(space.U[:, : space.decoder.k])
    tried: dict[float, tuple[float, CubatureRule]] = {}
    for i, closure in enumerate(recipe.closures):

        def tell(step: int, error: float, before: int = i * recipe.steps) -> None:
            if progress is not None:
                progress(before + step, error)

        aims, aside_aims = (Aims.joined(*aiming.aims(forces, closure)) for forces in (fitted, put_aside))
        found = fit_virtual(space.scene, U, start, aims, aside_aims, recipe, tell)
        tried[closure] = (np.nan if judge is None else judge(found)), found
        if judge is None:
            break
    least = min(error for error, _ in tried.values())
    closure = max(share for share, (error, _) in tried.items() if not error > TIE * least)
    on_mesh = np.nan if judge is None else judge(ladder[-1])
    table = np.array([[np.nan, on_mesh], *([share, error] for share, (error, _) in tried.items())])
    best = tried[closure][1]
    heldout, perturbed = aiming.aims(aiming.forces(kept_back, (recipe.seed, 2)), closure)
    return VirtualSelection(
        best,
        virtual_error(space.scene, U, best, heldout),
        virtual_error(space.scene, U, best, perturbed),
        closure,
        table,
    )


def largest(ladder: Sequence[CubatureRule], points: int) -> CubatureRule:
    """The largest set of a ladder with at most so many points, or its smallest."""
    return max((s for s in ladder if len(s.points) <= points), key=lambda s: len(s.points), default=ladder[0])


def choose_poses(poses: int, kept_back: Indices, recorded: int, recipe: VirtualRecipe) -> tuple[Indices, Indices]:
    """Poses to fit, and others to choose among what the fit has seen, of all but those kept back.

    Where there are rehearsed poses, recorded ones are as many, if need be several times: each time with another
    perturbed state.

    Raises:
        SolverError: no two poses are left.
    """
    others = np.random.default_rng(recipe.seed).permutation(np.setdiff1d(np.arange(poses), kept_back))
    if len(others) < 2:
        raise SolverError(f"virtual points need two poses besides those kept back; there are {len(others)}")
    aside = np.zeros(poses, dtype=bool)
    aside[others[: max(round(ASIDE * len(others)), 1)]] = True
    parts = []
    for left, most in ((others[~aside[others]], recipe.poses), (others[aside[others]], round(ASIDE * recipe.poses))):
        first, rest = left[left < recorded], left[left >= recorded]
        half = np.resize(first, max(most // 2, 1)) if len(first) and len(rest) else first[:most]
        parts.append(np.concatenate([half, rest[: max(most - len(half), 1)]]))
    return parts[0], parts[1]


class _Points:
    """Points with the maps and weights of the moment; reduced forces of states and their gradient."""

    def __init__(self, elements: Elements, maps: Array, weights: Array) -> None:
        self.elements, self.maps, self.weights = elements, maps, weights

    def residuals(self, aims: Aims, states: slice | NDArray[np.int64]) -> tuple[Array, Array, Array, int]:
        """A_tᵀ f − τ_t of some states, (T, r), the strains and weighted stresses there, (T, c, 9), and how many points
        have infinite energy and were left out.
        """
        c, _, k = self.maps.shape
        strains = (aims.q[states] @ self.maps.reshape(-1, k).T).reshape(-1, c, 9)
        if aims.strain is not None:
            strains += aims.strain[states]
        stresses = np.empty_like(strains)
        infinite = stresses_of_strains(self.elements, strains, self.weights, stresses)
        forces = stresses.reshape(len(strains), -1) @ self.maps.reshape(-1, k)
        projected = np.einsum("tkr,tk->tr", aims.projection[states], forces, optimize=True)
        return projected - aims.target[states], strains, stresses, infinite

    def gradient(self, aims: Aims, states: NDArray[np.int64]) -> tuple[Array, Array]:
        """Of the mean over some states of ‖residual‖², in the maps, (c, 9, k), and the weights' logarithms, (c,)."""
        k = self.maps.shape[2]
        residuals, strains, stresses, _ = self.residuals(aims, states)
        y = np.einsum("tkr,tr->tk", aims.projection[states], residuals, optimize=True) * (2 / len(states))
        along = (y @ self.maps.reshape(-1, k).T).reshape(strains.shape)
        changes = np.empty_like(strains)
        point_stress_changes(self.elements, strains, along, self.weights, changes)
        count = len(strains)
        of_maps = stresses.reshape(count, -1).T @ y + changes.reshape(count, -1).T @ aims.q[states]
        return of_maps.reshape(self.maps.shape), np.einsum("tsi,tsi->s", stresses, along)

    def error(self, aims: Aims) -> float:
        """‖A_tᵀ f − τ_t‖ / ‖τ_t‖ over all states; infinite where one has infinite energy."""
        total = 0.0
        for first in range(0, len(aims), STATES_AT_ONCE):
            residuals, _, _, infinite = self.residuals(aims, slice(first, first + STATES_AT_ONCE))
            if infinite:
                return np.inf
            total += float((residuals**2).sum())
        return float(np.sqrt(total) / np.linalg.norm(aims.target))


def virtual_error(scene: Scene, U: Array, cubature: CubatureRule, aims: Aims) -> float:
    """‖Σ w b − target‖ / ‖target‖ of a set, on the mesh or virtual, at the aims; infinite where a point is inverted."""
    return _points(scene, U, cubature).error(aims)


def fit_virtual(
    scene: Scene,
    U: Array,
    start: CubatureRule,
    fitted: Aims,
    kept_back: Aims,
    options: VirtualRecipe,
    progress: Progress | None = None,
) -> CubatureRule:
    """Virtual points that start as points of the mesh.

    The last ones, which small steps have settled; those of least error on `kept_back` where the last are worse by more
    than a tenth.

    Args:
        U: basis, (3n, k), without moving pins.
        progress: told the step and the error on `kept_back`, `JUDGED` times.

    Returns:
        A set with maps and the error on `fitted` as its training error.

    Raises:
        SolverError: the start has infinite energy at a kept-back state.
    """
    points = _points(scene, U, start)
    maps, weights = points.maps, points.weights
    unit = np.sqrt((maps**2).mean(axis=(0, 1)))
    least, best = points.error(kept_back), (maps, weights)
    if not np.isfinite(least):
        raise SolverError("cubature: virtual points start from points that are inverted in a pose; use more poses")
    moves, logarithms = np.zeros_like(maps), np.zeros_like(weights)
    adam = _Adam([moves, logarithms])
    rng = np.random.default_rng(options.seed)
    batch = min(options.batch, len(fitted))
    for step in range(options.steps):
        states = rng.choice(len(fitted), batch, replace=False)
        of_maps, of_logarithms = points.gradient(fitted, states)
        rate = options.rate * _share(step / options.steps)
        adam.step([of_maps * unit, of_logarithms], [rate, WEIGHTS_FASTER * rate])
        points.maps, points.weights = maps + moves * unit, weights * np.exp(logarithms)
        if (step + 1) % max(options.steps // JUDGED, 1) == 0 or step + 1 == options.steps:
            error = points.error(kept_back)
            if error < least:
                least, best = error, (points.maps, points.weights)
            if progress is not None:
                progress(step + 1, error)
    if not points.error(kept_back) <= SETTLED * least:
        points.maps, points.weights = best
    return replace(start, maps=points.maps, weights=points.weights, training_error=points.error(fitted))


def _points(scene: Scene, U: Array, cubature: CubatureRule) -> _Points:
    every, chosen = scene.elements, cubature.points
    elements = Elements(
        every.nodes[chosen],
        every.gradients[chosen],
        every.weights[chosen],
        every.kind[chosen],
        every.mu[chosen],
        every.lam[chosen],
    )
    return _Points(elements, cubature.strain_maps(scene, U), cubature.weights)


def _share(done: float) -> float:
    """Of the largest rate: a short warm-up, then half a cosine to nothing."""
    if done < WARM_UP:
        return (done + 1e-3) / WARM_UP
    return float(0.5 * (1 + np.cos(np.pi * (done - WARM_UP) / (1 - WARM_UP))))


class _Adam:
    """Adam on some arrays, in place."""

    def __init__(self, values: list[Array]) -> None:
        self._values, self._count = values, 0
        self._mean, self._square = [np.zeros_like(v) for v in values], [np.zeros_like(v) for v in values]

    def step(self, gradients: list[Array], rates: list[float]) -> None:
        """Move every array against its gradient."""
        length = float(np.sqrt(sum((g**2).sum() for g in gradients)))
        self._count += 1
        shorter = min(1.0, LONGEST / length) if length else 1.0
        entries = zip(self._values, self._mean, self._square, gradients, rates, strict=True)
        for value, mean, square, gradient, rate in entries:
            mean += (1 - FIRST) * (shorter * gradient - mean)
            square += (1 - SECOND) * ((shorter * gradient) ** 2 - square)
            scale = np.sqrt(square / (1 - SECOND**self._count)) + TINY
            value -= rate / (1 - FIRST**self._count) * mean / scale
