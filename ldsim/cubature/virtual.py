"""Virtual cubature points: points that are fitted, their strain maps as well as their weights.

A point of the mesh adds w Ψ(I + G q) to the potential, with the strain map G = ∂F/∂q that its place in the mesh
gives it. A model of r numbers needs no places, only a potential with the right gradient in z: here the entries of G
are free too, as if a point could lie anywhere and average over what is around it. Material, rest state (Ψ is least at
q = 0) and positive weights stay what they were, so the sum is still the energy of an elastic solid.

The fit is least squares over states of the training motions: Adam (Kingma and Ba 2015) on batches, from points of the
mesh, with the exact gradient

    ∂/∂G_s Σ_t ½ ‖A_tᵀ Σ_s w_s G_sᵀ P_s − τ_t‖² = Σ_t w_s (P_s y_tᵀ + (∂²Ψ/∂F² : G_s y_t) q_tᵀ),
    y_t = A_t (A_tᵀ Σ_s w_s G_sᵀ P_s − τ_t),

for A_t = J W / scale and the target τ_t. Hernández, Bravo and Ares de Parga 2023 ("CECM", arXiv 2308.03877) move points
continuously through the mesh; strain maps that belong to no place are ours.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ldsim.arrays import Array, Indices
from ldsim.cubature.kernels import point_stress_changes, stresses_of_strains
from ldsim.cubature.options import VirtualOptions
from ldsim.cubature.path import Tell
from ldsim.cubature.rule import CubatureRule, strain_maps
from ldsim.cubature.samples import PoseSpace, Samples, Tangents
from ldsim.errors import SolverError

# Adam: decays of both moments, the usual ones. A gradient longer than LONGEST is shortened to it.
FIRST, SECOND, TINY = 0.9, 0.999, 1e-8
LONGEST = 1.0
# The weights' logarithms move this many times as fast as the maps, in units of each map column's root mean square.
WEIGHTS_FASTER = 3.0
WARM_UP = 0.1
# How often the fit is judged on the poses put aside.
JUDGED = 20
STATES_AT_ONCE = 512
# The last points are taken unless their error is so many times the least.
SETTLED = 1.1


@dataclass(frozen=True, eq=False)
class Targets:
    """What virtual points are fitted to: T states, and the normalised reduced force that they are to have in each.

    Attributes:
        q: coordinates in the basis, (T, k).
        strain: what moving pins add to the strain of c points, (T, c, 9), or None where all stand still.
        projection: A_t = J W / scale of each state, (T, k, r); its transpose takes forces in q to what is compared.
        force: τ_t, (T, r), dimensionless.
    """

    q: Array
    strain: Array | None
    projection: Array
    force: Array

    def __len__(self) -> int:
        return len(self.q)

    @classmethod
    def of(cls, space: PoseSpace, samples: Samples, points: Indices) -> Targets:
        """The forces of the samples of finite energy, for points that start at some of the mesh, (c,)."""
        k, found = space.decoder.k, Tangents.of(space, samples, space.compliance)
        strain = None
        if space.U.shape[1] > k:  # a virtual point is strained by moving pins as the point of the mesh it started from
            lifted = strain_maps(space.scene, space.U[:, k:], points)
            strain = np.einsum("sij,tj->tsi", lifted, found.q[:, k:])
        return cls(found.q[:, :k], strain, found.projection / found.scales[:, None, None], found.target)

    @classmethod
    def joined(cls, first: Targets, second: Targets) -> Targets:
        """One after the other."""
        strain = None
        if first.strain is not None and second.strain is not None:
            strain = np.concatenate([first.strain, second.strain])
        q, projection = np.concatenate([first.q, second.q]), np.concatenate([first.projection, second.projection])
        return cls(q, strain, projection, np.concatenate([first.force, second.force]))


def virtual_error(space: PoseSpace, rule: CubatureRule, targets: Targets) -> float:
    """‖Σ w b − τ‖ / ‖τ‖ of a rule, on the mesh or virtual; infinite where a point is inverted in a state."""
    return MovablePoints(space, rule).error(targets)


def fit_virtual(
    space: PoseSpace,
    start: CubatureRule,
    targets: tuple[Targets, Targets],
    options: VirtualOptions,
    seed: int,
    tell: Tell | None = None,
) -> CubatureRule:
    """Virtual points that start as points of the mesh.

    The last ones, which small steps have settled; those of least error on the states put aside where the last are
    worse by more than a tenth.

    Args:
        targets: to fit, and put aside to choose among what the fit has seen.
        seed: of the batches.
        tell: told the step and the error on the states put aside, `JUDGED` times.

    Returns:
        A rule with maps and the error on the fitted states as its training error.

    Raises:
        SolverError: the start has infinite energy in a state put aside.
    """
    fitted, aside = targets
    points = MovablePoints(space, start)
    maps, weights = points.maps, points.weights
    # The columns of U are of different size: each moves in units of its own, and the weights by factors.
    unit = np.sqrt((maps**2).mean(axis=(0, 1)))
    least, best = points.error(aside), (maps, weights)
    if not np.isfinite(least):
        raise SolverError("cubature: virtual points start from points that are inverted in a pose; use more poses")
    moves, logarithms = np.zeros_like(maps), np.zeros_like(weights)
    adam = _Adam([moves, logarithms])
    rng = np.random.default_rng(seed)
    batch = min(options.batch, len(fitted))
    for step in range(options.steps):
        states = rng.choice(len(fitted), batch, replace=False)
        of_maps, of_logarithms = points.gradient(fitted, states)
        rate = options.rate * _share(step / options.steps)
        adam.step([of_maps * unit, of_logarithms], [rate, WEIGHTS_FASTER * rate])
        points.maps, points.weights = maps + moves * unit, weights * np.exp(logarithms)
        if (step + 1) % max(options.steps // JUDGED, 1) == 0 or step + 1 == options.steps:
            error = points.error(aside)
            if error < least:
                least, best = error, (points.maps, points.weights)
            if tell is not None:
                tell(step + 1, error)
    if not points.error(aside) <= SETTLED * least:
        points.maps, points.weights = best
    return replace(start, maps=points.maps, weights=points.weights, training_error=points.error(fitted))


class MovablePoints:
    """Points with the maps and weights of the moment; reduced forces of states and their gradient."""

    def __init__(self, space: PoseSpace, rule: CubatureRule) -> None:
        self.elements = rule.elements(space.scene)
        self.maps, self.weights = rule.strain_maps(space.scene, space.basis), rule.weights

    def residuals(self, targets: Targets, states: slice | Indices) -> tuple[Array, Array, Array, int]:
        """A_tᵀ f − τ_t of some states, (T, r), the strains and weighted stresses there, (T, c, 9), and how many points
        have infinite energy and were left out.
        """
        c, _, k = self.maps.shape
        strains = (targets.q[states] @ self.maps.reshape(-1, k).T).reshape(-1, c, 9)
        if targets.strain is not None:
            strains += targets.strain[states]
        stresses = np.empty_like(strains)
        infinite = stresses_of_strains(self.elements, strains, self.weights, stresses)
        forces = stresses.reshape(len(strains), -1) @ self.maps.reshape(-1, k)
        projected = np.einsum("tkr,tk->tr", targets.projection[states], forces, optimize=True)
        return projected - targets.force[states], strains, stresses, infinite

    def gradient(self, targets: Targets, states: Indices) -> tuple[Array, Array]:
        """Of the mean over some states of ‖residual‖², in the maps, (c, 9, k), and the weights' logarithms, (c,)."""
        k = self.maps.shape[2]
        residuals, strains, stresses, _ = self.residuals(targets, states)
        y = np.einsum("tkr,tr->tk", targets.projection[states], residuals, optimize=True) * (2 / len(states))
        along = (y @ self.maps.reshape(-1, k).T).reshape(strains.shape)
        changes = np.empty_like(strains)
        point_stress_changes(self.elements, strains, along, self.weights, changes)
        count = len(strains)
        of_maps = stresses.reshape(count, -1).T @ y + changes.reshape(count, -1).T @ targets.q[states]
        return of_maps.reshape(self.maps.shape), np.einsum("tsi,tsi->s", stresses, along)

    def error(self, targets: Targets) -> float:
        """‖A_tᵀ f − τ_t‖ / ‖τ_t‖ over all states; infinite where one has infinite energy."""
        total = 0.0
        for first in range(0, len(targets), STATES_AT_ONCE):
            residuals, _, _, infinite = self.residuals(targets, slice(first, first + STATES_AT_ONCE))
            if infinite:
                return np.inf
            total += float((residuals**2).sum())
        return float(np.sqrt(total) / np.linalg.norm(targets.force))


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
