"""Samples: poses of a space, and the reduced elastic forces there that a cubature rule is to have.

The reduced force of the pose u = U φ(z) is J(z)ᵀ Uᵀ f(u), with J = ∂φ/∂z and the elastic force f: in the space of U An,
Kim and James 2008, "Optimizing Cubature for Efficient Integration of Subspace Deformations", Sec. 4; on the tangent of
a nonlinear manifold Jain and Tiso 2017, "Hyper-reduction over nonlinear manifolds for large nonlinear mechanical
systems", arXiv:1710.05160.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ldsim.arrays import Array, Indices
from ldsim.errors import SolverError
from ldsim.jit import in_threads
from ldsim.mechanics.elastic import Elements, add_elastic_gradient
from ldsim.mechanics.scene import Scene
from ldsim.space.decoder import Decoder
from ldsim.space.space import Space

POSES_AT_ONCE = 16
# A pose is never scaled by less than this share of the median force: those near rest would else decide alone.
FLOOR = 0.05
# Forces below this share of those at a strain of one are rounding errors.
ROUNDING = 1e-13


@dataclass(frozen=True, eq=False)
class Samples:
    """T states of a space, and the elastic force in each.

    Attributes:
        z: their coordinates, (T, r).
        q: those of U, φ(z), and beside them what moving pins prescribe, (T, k + l).
        forces: Uᵀ f, (T, k), N; NaN where the energy is infinite.
    """

    z: Array
    q: Array
    forces: Array

    def plus(self, forces: Array) -> Samples:
        """The same states with other forces added to theirs, (T, k)."""
        return replace(self, forces=self.forces + forces)

    @classmethod
    def joined(cls, *parts: Samples) -> Samples:
        """Some samples one after another."""
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in ("z", "q", "forces")))


@dataclass(frozen=True, eq=False)
class PoseSpace:
    """A reduced space with the poses of the training motions; its rule counts for nothing.

    Attributes:
        stiffness: K̃₀ = UᵀK₀U, (k, k).
        z: coordinates of the poses, (N, r).
        displacement: the true displacement of pose t, (n, 3), metres; None where none is asked for.
        given: what moving pins prescribe in the poses, (N, l); None where all stand still.
        threads: that share out poses, 0 for one a core. No result depends on it.

    Raises:
        SolverError: on shapes that do not fit.
    """

    space: Space
    stiffness: Array
    z: Array
    displacement: Callable[[int], NDArray[np.floating]] | None = None
    given: Array | None = None
    threads: int = 0

    def __post_init__(self) -> None:
        pins = 0 if self.given is None else self.given.shape[1]
        rows, columns = 3 * self.scene.mesh.n_vertices, self.decoder.k + pins
        if self.U.shape != (rows, columns):
            raise SolverError(
                f"cubature: basis has shape {self.U.shape}; this mesh and decoder need ({rows}, {columns})"
            )
        if self.z.ndim != 2 or self.z.shape[1] != self.decoder.r or len(self.z) == 0:
            raise SolverError(f"cubature: poses have shape {self.z.shape}; expected (T, {self.decoder.r}) with T > 0")

    @property
    def scene(self) -> Scene:
        """The solid."""
        return self.space.scene

    @property
    def decoder(self) -> Decoder:
        """φ: R^r → R^k, the identity in a linear space."""
        return self.space.decoder

    @property
    def basis(self) -> Array:
        """U, (3n, k)."""
        return self.space.reduced_basis.matrix

    @cached_property
    def U(self) -> Array:
        """U and beside it the fields of moving pins, (3n, k + l)."""
        fields = self.space.fields
        return fields.reshape(-1, fields.shape[2])

    @cached_property
    def compliance(self) -> Array:
        """The metric that measures forces by the displacement which they cause at rest, (r, r)."""
        return rest_compliance(self.stiffness, self.decoder, self.z)

    def linear(self) -> PoseSpace:
        """The same poses in the linear space of all of U."""
        identity = Decoder.identity(self.decoder.k)
        return replace(self, space=replace(self.space, decoder=identity), z=self.decoder(self.z))

    def samples(self, z: Array, poses: Indices) -> Samples:
        """The solid at coordinates z, (T, r), with its pins as in some poses, (T,)."""
        q = self.decoder(z)
        if self.given is not None:
            q = np.hstack([q, self.given[poses]])
        return Samples(z, q, self._forces(lambda block: q[block.start : block.stop] @ self.U.T, len(q)))

    def true_forces(self, poses: Indices) -> Array:
        """Uᵀ f of some poses as they truly were, (T, k), N, without decoding; NaN where the energy is infinite."""
        return self._forces(lambda block: np.stack([self._true(int(poses[t])) for t in block]), len(poses))

    def _true(self, pose: int) -> Array:
        assert self.displacement is not None, "a closure needs the true displacements"
        u = np.ascontiguousarray(self.displacement(pose), dtype=np.float64)
        if u.shape != (self.scene.mesh.n_vertices, 3):  # the compiled loops do not check
            raise SolverError(
                f"cubature: displacement of pose {pose} has shape {u.shape}; expected ({self.scene.mesh.n_vertices}, 3)"
            )
        return u

    def _forces(self, displacements: Callable[[range], Array], count: int) -> Array:
        """Uᵀ f of poses 0 … count − 1, given in blocks of displacements in metres."""
        elements = self.scene.elements

        def forces(block: range) -> Array:
            u = displacements(block).reshape(len(block), -1, 3)
            gradients = np.zeros(u.shape)
            energies = [add_elastic_gradient(elements, *pair) for pair in zip(u, gradients, strict=True)]
            projected: Array = gradients.reshape(len(block), -1) @ self.basis
            projected[~np.isfinite(energies) | ~np.isfinite(projected).all(axis=1)] = np.nan
            return projected

        found = list(in_threads(forces, blocks(count), self.threads))
        return np.concatenate([np.empty((0, self.decoder.k)), *found])


@dataclass(frozen=True, eq=False)
class Tangents:
    """The samples of finite energy on the tangent of their space: what their forces are compared by.

    Each is divided by max(‖f‖, floor · median ‖f‖), so that neither the most strained poses nor those near rest decide
    alone.

    Attributes:
        kept: which of the samples these are, (T,).
        q: their coordinates, (T, k + l).
        projection: J W, (T, k, r), with the metric W; its transpose takes Uᵀf to what is compared.
        scales: what each is divided by, (T,).
        target: the forces, projected and divided, (T, r), dimensionless.
    """

    kept: Indices
    q: Array
    projection: Array
    scales: Array
    target: Array

    @classmethod
    def of(cls, space: PoseSpace, samples: Samples, metric: Array | None) -> Tangents:
        """The tangents at some samples of a space; forces measured as ‖Wᵀ Jᵀ Uᵀ f‖, without a metric W as ‖Jᵀ Uᵀ f‖.

        Raises:
            SolverError: no sample has finite energy, or none a force.
        """
        kept = np.flatnonzero(np.isfinite(samples.forces).all(axis=1))
        if len(kept) == 0:
            raise SolverError(
                f"cubature: all {len(samples.z)} poses have infinite energy (inverted points); give poses without "
                "inversion or use a material that allows it"
            )
        projection = np.stack([space.decoder.jacobian(z) for z in samples.z[kept]])
        if metric is not None:
            projection = projection @ metric
        reduced = np.einsum("tkr,tk->tr", projection, samples.forces[kept])
        rounding = ROUNDING * (1.0 if metric is None else float(np.linalg.norm(metric, 2)))
        scales = pose_scales(np.linalg.norm(reduced, axis=1), rounding * _unit_force(space.scene.elements))
        return cls(kept, samples.q[kept], projection, scales, reduced / scales[:, None])


def rest_compliance(stiffness: Array, decoder: Decoder, z: Array) -> Array:
    """W = K_z^(−1/2), symmetric, with K_z = mean_t J(z_t)ᵀ K̃₀ J(z_t); so ‖Wᵀf‖² = fᵀ K_z⁻¹ f.

    A force error e displaces the solid by K⁻¹e and costs the energy ½ eᵀK⁻¹e. Its plain size hides the soft directions,
    in which the solid moves most and of which the stiffest ones, a hundred times stiffer, leave nothing in a tolerance.

    Args:
        stiffness: K̃₀ = UᵀK₀U, (k, k).
        z: poses to average over, (T, r).

    Returns:
        (r, r) float64. Directions softer than 1e-12 of the stiffest count as that stiff.
    """
    average = np.zeros((decoder.r, decoder.r))
    z = z[:1] if decoder.is_identity else z
    for row in z:
        J = decoder.jacobian(row)
        average += J.T @ stiffness @ J / len(z)
    values, vectors = np.linalg.eigh(average)
    W: Array = (vectors / np.sqrt(np.maximum(values, 1e-12 * values.max()))) @ vectors.T
    return W


def perturbed(z: Array, poses: Indices, distance: float, seed: tuple[int, ...]) -> Array:
    """Some poses, each moved at random by so many standard deviations of all poses, (T, r)."""
    steps = np.random.default_rng(seed).standard_normal((len(poses), z.shape[1]))
    moved: Array = z[poses] + distance * steps * z.std(axis=0)
    return moved


def pose_scales(norms: Array, rounding: float = 0.0) -> Array:
    """max(‖f_t‖, floor · median ‖f‖), N; never zero, for rest poses hold rounding errors alone.

    Raises:
        SolverError: no norm is above `rounding`.
    """
    if not norms.max() > rounding:
        raise SolverError(f"cubature: the elastic force of all {len(norms)} poses is zero; give poses away from rest")
    return np.maximum(norms, max(FLOOR * float(np.median(norms)), rounding))


def blocks(count: int) -> list[range]:
    """Poses in blocks that do not depend on the number of threads, and so neither do sums over them."""
    return [range(first, min(first + POSES_AT_ONCE, count)) for first in range(0, count, POSES_AT_ONCE)]


def _unit_force(elements: Elements) -> float:
    """Norm of the vertex forces Σ_s w_s (2μ + λ) ‖∇N‖ of a strain of one, N."""
    stress = elements.weights * (2 * elements.mu + elements.lam)
    shares = stress[:, None] * np.linalg.norm(elements.gradients, axis=2)
    return float(np.linalg.norm(np.bincount(elements.nodes.ravel(), shares.ravel())))
