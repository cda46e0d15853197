"""Which poses a condensed space learns from, and the work of relaxing them, which is kept piece by piece."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ldsim.arrays import Array, Indices
from ldsim.artefacts.training import TrainingStore
from ldsim.errors import SolverError
from ldsim.jit import in_threads
from ldsim.learn.options import TrainOptions
from ldsim.mechanics.elastic import add_elastic_gradient
from ldsim.pipeline.progress import Progress
from ldsim.space.relaxation import Relaxation, Relaxed

# Of a pose by its number, (n, 3), metres.
Frames = Callable[[int], NDArray[np.floating]]

# Poses that are relaxed in one piece of work, which is kept when it is done.
TOGETHER = 8
# Directions in which the tangents of a pose are learned, this long beside the poses, in energy coordinates.
DIRECTIONS, LENGTH = 8, 0.3
# Perturbed poses: one of these shares of the energy of a pose is added, alike in all directions, but never less than
# `LEAST` of what poses have in the mean, of which `TYPICAL` are looked at.
SHARES, LEAST, TYPICAL = (0.03, 0.1, 0.3, 1.0), 0.1, 40


class ChosenPoses:
    """Which of many poses are relaxed, and the work on one piece of them.

    Args:
        z: coordinates of all poses, (N, r).
        displacement: of a pose by its number.
        count: how many are relaxed at most; each also with perturbed ones around it (`train.condensed.shell`).
        beside: coordinates of what is relaxed already, (m, r): poses are taken far from them.
    """

    def __init__(
        self,
        relaxation: Relaxation,
        z: Array,
        displacement: Frames,
        options: TrainOptions,
        count: int,
        beside: Array | None = None,
    ) -> None:
        self.relaxation, self.z, self._displacement, self._options = relaxation, z, displacement, options
        rng = np.random.default_rng((options.seed, 0))
        self._softest = np.linalg.eigvalsh(relaxation.rest.stiffness)[0]
        root = energy_root(relaxation)
        y = z @ root
        # most frames of a motion are near rest, and a run is lost where it is far; who asks for more poses gets a
        # longer prefix of the same order, so only those that are new are relaxed
        self.chosen = farthest_points(y, min(count, len(z)), None if beside is None else beside @ root)
        size = np.sqrt(np.mean(np.sum(y**2, axis=1)))
        self._to_z = LENGTH * size * np.linalg.inv(root)
        some = [displacement(int(number)).astype(np.float64) for number in rng.permutation(len(z))[:TYPICAL]]
        energies = np.array([add_elastic_gradient(relaxation.scene.elements, u, 0 * u) for u in some])
        # a synthetic pose may be inverted somewhere, where some materials have infinite energy
        finite = energies[np.isfinite(energies)]
        self._typical = float(finite.mean()) if len(finite) else 0.0

    @property
    def wanted(self) -> int:
        """How many samples there are, if none is lost."""
        return len(self.chosen) * (1 + self._options.condensed.shell)

    def identity(self, piece: int) -> str:
        """A hash of all that the relaxed poses of a piece depend on."""
        text = f"{self._options.seed} {self.of(piece)} {self._options.condensed.shell}"
        fields = self.relaxation.coordinates.matrix
        return hashlib.sha256(self.z.tobytes() + fields.tobytes() + text.encode()).hexdigest()

    def of(self, piece: int) -> list[int]:
        """The numbers of a piece's poses."""
        return [int(number) for number in self.chosen[piece * TOGETHER : (piece + 1) * TOGETHER]]

    def relaxed(self, piece: int) -> dict[str, NDArray[np.generic]]:
        """The samples of one piece; where what z leaves free has no stable equilibrium, there is none.

        Where the solid would buckle if z were let go, V_eff curves downwards, and is learned as anywhere else.
        """
        found: list[Relaxed] = []
        for number in self.of(piece):
            rng = np.random.default_rng((self._options.seed, 1, number))
            try:
                base = self.relaxation.from_pose(self._displacement(number))
            except SolverError:
                continue
            found.append(replace(base, inverse=None))
            for _ in range(self._options.condensed.shell):
                try:
                    pose = self.relaxation(base.z + self._noise(base, rng), base)
                    found.append(replace(pose, inverse=None))
                except SolverError:
                    continue
        return self._arrays(found, np.random.default_rng((piece, 2)))

    def _noise(self, base: Relaxed, rng: np.random.Generator) -> Array:
        """A random change of z, longest where the pose is softest.

        Noise of one size in every coordinate would stretch and press the solid along directions in which it hardly
        moves: what is curled up when a solid bends far is stiff at rest.
        """
        values, vectors = np.linalg.eigh(base.stiffness)
        energy = rng.choice(SHARES) * max(base.energy, LEAST * self._typical)
        lengths = np.sqrt(2 * energy / len(values) / np.maximum(np.abs(values), self._softest))
        change: Array = vectors @ (lengths * rng.normal(size=len(values)))
        return change

    def _arrays(self, found: list[Relaxed], rng: np.random.Generator) -> dict[str, NDArray[np.generic]]:
        V = self.relaxation.coordinates.fields
        r, size = V.shape[2], V.shape[0] * 3
        normal = rng.normal(size=(len(found), DIRECTIONS, r))
        directions = normal / np.linalg.norm(normal, axis=2, keepdims=True) @ self._to_z
        slaved = [(pose.u - V @ pose.z).ravel() for pose in found]
        along = [d @ (pose.tangents - V).reshape(size, r).T for pose, d in zip(found, directions, strict=True)]
        return {
            "z": np.array([pose.z for pose in found]).reshape(-1, r),
            "force": np.array([pose.force for pose in found]).reshape(-1, r),
            "stiffness": np.array([pose.stiffness for pose in found]).reshape(-1, r, r),
            "directions": directions,
            "slaved": np.array(slaved, dtype=np.float32).reshape(-1, size),
            "along": np.array(along, dtype=np.float32).reshape(-1, DIRECTIONS, size),
        }


def energy_root(relaxation: Relaxation) -> Array:
    """S₀^½, (r, r): in y = S₀^½ z rest is equally stiff along all axes, ½ ‖y‖² J for small motions."""
    values, vectors = np.linalg.eigh(relaxation.rest.stiffness)
    root: Array = (vectors * np.sqrt(values)) @ vectors.T
    return root


def farthest_points(y: Array, count: int, beside: Array | None = None) -> Indices:
    """Numbers of `count` rows of y, (N, r): each the farthest from rest, y = 0, from `beside` and those before it."""
    distance, chosen = np.linalg.norm(y, axis=1), np.empty(count, dtype=np.int64)
    if beside is not None and len(beside):
        distance = np.minimum(distance, cKDTree(beside).query(y)[0])  # all distances at once would not fit in memory
    for i in range(count):
        chosen[i] = distance.argmax()
        distance = np.minimum(distance, np.linalg.norm(y - y[chosen[i]], axis=1))
        distance[chosen[: i + 1]] = -1.0  # none twice, where frames repeat
    return chosen


class Piece:
    """The relaxed poses of one piece of work: z and S are held, all is read from its file when it is asked for.

    Attributes:
        z: coordinates, (b, r) float64.
        stiffness: S there, (b, r, r) float64.
    """

    def __init__(self, store: TrainingStore, arrays: Mapping[str, NDArray[np.generic]]) -> None:
        self._store = store
        self.z, self.stiffness = (np.asarray(arrays[name], dtype=np.float64) for name in ("z", "stiffness"))

    def read(self) -> Mapping[str, NDArray[np.generic]]:
        found = self._store.load()
        if found is None:
            raise SolverError("relaxed poses were removed while they were used; run the stage again")
        return found

    def rows(self) -> NDArray[np.float32]:
        """Slaved parts and their changes along the directions, (b (1 + d), 3n)."""
        arrays = self.read()
        slaved, along = arrays["slaved"], arrays["along"]
        return np.concatenate([slaved, along.reshape(-1, slaved.shape[1])]).astype(np.float32)


def relaxed_pieces(poses: ChosenPoses, partial: Path, name: str, progress: Progress) -> list[Piece]:
    """All pieces, each kept in `partial` as soon as it is done; what an earlier run has done is not done again."""
    pieces = range(-(-len(poses.chosen) // TOGETHER))
    stores = [TrainingStore(partial, f"{name} {piece}", poses.identity(piece)) for piece in pieces]
    with progress.bar("train: poses relaxed", poses.wanted, "pose") as bar:
        kept = ((piece, store.load()) for piece, store in enumerate(stores))
        done = {piece: Piece(stores[piece], arrays) for piece, arrays in kept if arrays is not None}
        bar.reach(poses.wanted * len(done) // max(len(pieces), 1))
        todo = [piece for piece in pieces if piece not in done]
        for piece, arrays in zip(todo, in_threads(poses.relaxed, todo), strict=True):
            stores[piece].save(arrays)
            done[piece] = Piece(stores[piece], arrays)
            bar.reach(poses.wanted * len(done) // len(pieces))
    return [done[piece] for piece in pieces]
