"""Small solids and poses for the tests of cubature."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ldsim.cubature.rule import CubatureRule
from ldsim.cubature.samples import PoseSpace
from ldsim.cubature.terms import ForceTerm
from ldsim.mechanics.materials import MATERIALS
from ldsim.mechanics.materials.kernels import energy
from ldsim.mechanics.scene import Scene
from ldsim.mesh.shapes import voxel_mesh
from ldsim.space.basis import Basis
from ldsim.space.decoder import Decoder
from ldsim.space.encoder import IDENTITY
from ldsim.space.lifting import Lifting
from ldsim.space.space import Space
from tests.helpers import uniform_scene

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Problem:
    """A scene, a basis (3n, k), a decoder, poses z (T, r) and more poses that no fit sees."""

    scene: Scene
    U: Array
    decoder: Decoder
    z: Array
    held_out: Array

    def space(self, lifting: Lifting | None = None) -> Space:
        basis = Basis.of(self.U, self.scene.mass)
        return Space("latent", self.scene, basis, self.decoder, IDENTITY, CubatureRule.every(self.scene), lifting)

    def poses(self, z: Array | None = None, threads: int = 1) -> PoseSpace:
        """Its poses or others, without a stiffness."""
        k = self.decoder.k
        return PoseSpace(self.space(), np.zeros((k, k)), self.z if z is None else z, threads=threads)

    def forces(
        self, z: Array | None = None, metric: Array | None = None, candidates: NDArray[np.int64] | None = None
    ) -> ForceTerm:
        """The force term of these poses."""
        return forces_of(self.poses(z), metric, candidates)


def forces_of(space: PoseSpace, metric: Array | None = None, candidates: NDArray[np.int64] | None = None) -> ForceTerm:
    """The force term of all poses of a space."""
    return ForceTerm(space, space.samples(space.z, np.arange(len(space.z))), metric, candidates)


class GivenColumns:
    """A term of cubature with a matrix given whole: target A 1."""

    def __init__(self, A: Array, point_weights: Array) -> None:
        self.A, self._weights, self._target = A, point_weights, A.sum(axis=1)

    @property
    def point_weights(self) -> Array:
        return self._weights

    @property
    def target(self) -> Array:
        return self._target

    def columns(self, points: NDArray[np.int64]) -> Array:
        return self.A[:, points]

    def correlations(self, residual: Array) -> Array:
        product: Array = self.A.T @ residual
        return product


def beam_scene(cubes: tuple[int, int, int], cell_type: str, material: str = "stable_neo_hookean") -> Scene:
    """A beam along x of cubes, or of six tets a cube, pinned at its left."""
    mesh = voxel_mesh(np.ones(cubes, dtype=bool), 0.1, cell_type)
    given = {"youngs_modulus": 1e6, "poisson_ratio": 0.4, "gravity": (0.0, 0.0, -9.81), "time_step": 0.01}
    return uniform_scene(mesh, mesh.vertices[:, 0] == 0, material=material, **given)


def two_materials(scene: Scene) -> Scene:
    """Every third cell ten times stiffer and of another material."""
    third = np.arange(scene.mesh.n_cells) % 3 == 0
    other = np.int8(MATERIALS["st_venant_kirchhoff"])
    factor = np.where(third, 10.0, 1.0)
    return replace(scene, material=np.where(third, other, scene.material), mu=factor * scene.mu, lam=factor * scene.lam)


def smooth_poses(scene: Scene, count: int, seed: int) -> Array:
    """Random bends, twists and waves that are zero at the clamp, (count, 3n), metres."""
    rng = np.random.default_rng(seed)
    x = scene.mesh.vertices / scene.mesh.vertices.max(axis=0)
    length = scene.mesh.diagonal
    waves = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, 0, 1], [0, 1, 1]])
    fields = np.cos(np.pi * x @ waves.T) * x[:, :1] ** 1.5
    amplitude = 0.06 * length / (1 + waves.sum(axis=1)) ** 2
    coefficients = rng.standard_normal((count, len(waves), 3)) * amplitude[:, None]
    return np.einsum("nw,twi->tni", fields, coefficients).reshape(count, -1)


def basis_of(poses: Array, k: int) -> Array:
    return np.ascontiguousarray(np.linalg.svd(poses, full_matrices=False)[2][:k].T)


def linear_problem(scene: Scene, k: int, count: int, seed: int = 0) -> Problem:
    poses, held_out = smooth_poses(scene, count, seed), smooth_poses(scene, count, seed + 1000)
    U = basis_of(poses, k)
    return Problem(scene, U, Decoder.identity(k), poses @ U, held_out @ U)


def latent_problem(scene: Scene, r: int, k: int, count: int, seed: int = 0) -> Problem:
    """An untrained network with a linear skip: as nonlinear as a trained one, at no cost."""
    rng = np.random.default_rng(seed)
    linear = linear_problem(scene, k, count, seed)
    sizes = [r, 16, k]
    q = linear.z.std(axis=0)
    weights = [rng.standard_normal((a, b)) / np.sqrt(a) for a, b in pairwise(sizes)]
    weights[-1] *= 0.5 * q
    skip = np.zeros((r, k))
    skip[:, :r] = np.diag(q[:r])
    decoder = Decoder.network(weights, [rng.standard_normal(b) for b in sizes[1:-1]] + [np.zeros(k)], "elu", skip)
    return Problem(scene, linear.U, decoder, rng.standard_normal((count, r)), rng.standard_normal((count, r)))


def point_energies(p: Problem, u: Array) -> Array:
    """w_s Ψ(F_s), (s,), with F by einsum."""
    e = p.scene.elements
    F = np.eye(3) + np.einsum("sai,saj->sij", u.reshape(-1, 3)[e.nodes], e.gradients)
    densities = [
        energy(kind, tuple(f.ravel()), mu, lam) for kind, f, mu, lam in zip(e.kind, F, e.mu, e.lam, strict=True)
    ]
    return e.weights * np.array(densities)
