"""The reduced forces that virtual points are to have: poses, and what the solid answers there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ldsim.cubature.forces import pose_scales, total_forces
from ldsim.cubature.metric import rest_compliance
from ldsim.cubature.rule import strain_maps
from ldsim.cubature.selection import PoseSpace
from ldsim.errors import SolverError

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

# Perturbed states lie this far from their poses, in standard deviations of all poses, evenly on a logarithmic scale.
NEAREST, FARTHEST = 0.03, 0.3
FLOOR = 0.05


@dataclass(frozen=True, eq=False)
class Aims:
    """T states and the normalised reduced forces there, those of finite energy alone.

    Attributes:
        q: outer coordinates, (T, k).
        strain: what moving pins add to the strain of c points, (T, c, 9), or None where all stand still.
        projection: J W / scale of each state, (T, k, r); its transpose maps forces in q to what is compared.
        target: the forces to reach, (T, r), dimensionless.
    """

    q: Array
    strain: Array | None
    projection: Array
    target: Array

    def __len__(self) -> int:
        return len(self.q)

    @classmethod
    def joined(cls, *parts: Aims) -> Aims:
        """One after another."""
        strain = None if parts[0].strain is None else np.concatenate([part.strain for part in parts])
        return cls(
            np.concatenate([part.q for part in parts]),
            strain,
            np.concatenate([part.projection for part in parts]),
            np.concatenate([part.target for part in parts]),
        )


@dataclass(frozen=True, eq=False)
class PoseForces:
    """Poses and a perturbed state of each: codes, (T, r), and forces there, Uᵀ f, (T, k) N; NaN where infinite.

    Attributes:
        z, decoded, true: of the poses; forces of the decoded and of the true ones.
        moved, near: of the perturbed states.
        given: what moving pins prescribe, (T, l), or None.
    """

    z: Array
    decoded: Array
    true: Array
    moved: Array
    near: Array
    given: Array | None


class Aiming:
    """Makes aims of poses of a space, for some points, with a share of the forces of the true poses: the closure.

    The latent pose û = U φ(z) of a true pose u is a little off, and in a stiff solid its forces are off by much more:
    the latent solid then rests and swings elsewhere. Where the closure is 1, the force at z is to be the true one,
    J(z)ᵀ Uᵀ f(u), so that z is where the true solid would be, and what the reduction adds in stiffness goes. A
    perturbed state keeps the difference of its pose: J(z')ᵀ Uᵀ (f(û') + f(u) − f(û)).

    Args:
        points: points of the mesh whose strain moving pins change, (c,).
        threads: 0 for one a core.
    """

    def __init__(self, space: PoseSpace, points: Indices, threads: int = 0) -> None:
        self._space, self._threads = space, threads
        self._metric = rest_compliance(space.stiffness, space.decoder, space.z)
        k = space.decoder.k
        self._U = np.ascontiguousarray(space.U[:, :k])
        self._lifted = strain_maps(space.scene, space.U[:, k:], points) if space.U.shape[1] > k else None

    def forces(self, poses: Indices, seed: tuple[int, ...]) -> PoseForces:
        """The forces of some poses, and of a perturbed state of each drawn with a seed."""
        space = self._space
        z, given = space.z[poses], space.given_in(poses)
        moved = _moved(z, space.z.std(axis=0), seed)
        true = self._forces(lambda part: np.stack([space.displacement(int(poses[t])) for t in part]), len(poses))
        return PoseForces(z, self._decoded_forces(z, given), true, moved, self._decoded_forces(moved, given), given)

    def aims(self, forces: PoseForces, closure: float) -> tuple[Aims, Aims]:
        """Aims at poses, and at their perturbed states.

        Raises:
            SolverError: no pose, or no perturbed state, has finite energy; a closure outside 0 … 1.
        """
        if not 0 <= closure <= 1:
            raise SolverError(f"cubature: closure share is {closure:g}; allowed is 0 (decoded poses) … 1 (true poses)")
        excess = closure * (forces.true - forces.decoded) if closure else np.zeros_like(forces.decoded)
        return (
            self._aims(forces.z, forces.given, forces.decoded + excess),
            self._aims(forces.moved, forces.given, forces.near + excess),
        )

    def _decoded_forces(self, z: Array, given: Array | None) -> Array:
        space = self._space
        q = space.decoder(z) if given is None else np.hstack([space.decoder(z), given])
        return self._forces(lambda part: q[part.start : part.stop] @ space.U.T, len(q))

    def _forces(self, displacements: Callable[[range], NDArray[np.floating]], count: int) -> Array:
        """Uᵀ f of blocks of displacements, (T, k) N; NaN where the energy is infinite."""

        def exactly(part: range) -> Array:
            return np.ascontiguousarray(displacements(part), dtype=np.float64)

        forces, finite = total_forces(self._space.scene.elements, self._U, exactly, count, self._threads)
        forces[~finite] = np.nan
        return forces

    def _aims(self, z: Array, given: Array | None, forces: Array) -> Aims:
        kept = np.isfinite(forces).all(axis=1)
        if not kept.any():
            raise SolverError(
                f"cubature: all {len(z)} poses have infinite energy (inverted points); give poses without inversion or "
                "use a material that allows it"
            )
        z, forces = z[kept], forces[kept]
        decoder = self._space.decoder
        projection = np.stack([decoder.jacobian(row) for row in z]) @ self._metric
        target = np.einsum("tkr,tk->tr", projection, forces)
        scales = pose_scales(np.linalg.norm(target, axis=1), FLOOR, 0.0)
        projection /= scales[:, None, None]
        target /= scales[:, None]
        strain = None
        if self._lifted is not None and given is not None:
            strain = np.einsum("sij,tj->tsi", self._lifted, given[kept])
        return Aims(decoder(z), strain, projection, target)


def _moved(z: Array, spread: Array, seed: tuple[int, ...]) -> Array:
    """Each of some codes moved at random."""
    rng = np.random.default_rng(seed)
    distance = np.exp(rng.uniform(np.log(NEAREST), np.log(FARTHEST), (len(z), 1)))
    moved: Array = z + distance * spread * rng.standard_normal(z.shape)
    return moved
