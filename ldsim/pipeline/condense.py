"""The condensed latent space of the stage train: poses are relaxed, then potential and decoder are fitted to them."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ldsim.arrays import Array
from ldsim.artefacts.records import StoredModel
from ldsim.artefacts.training import TrainingStore
from ldsim.errors import SettingsError, SolverError
from ldsim.jit import in_threads
from ldsim.learn.condensed import Condensed, CondensedSamples, fit_condensed
from ldsim.learn.options import TrainOptions
from ldsim.mechanics.elastic import add_elastic_gradient
from ldsim.pipeline.progress import Bar, Progress
from ldsim.run import Run
from ldsim.space.basis import Basis, is_identity
from ldsim.space.decoder import Decoder
from ldsim.space.encoder import IDENTITY
from ldsim.space.novelty import fit_novelty
from ldsim.space.pca import leading_modes, orthonormal_rows, spectrum
from ldsim.space.projection import reconstruction_error
from ldsim.space.relaxation import Relaxation, Relaxed

Frames = Callable[[int], NDArray[np.floating]]

# Where r is left out: columns of the basis are ordered, and more of them cost little.
COORDINATES = 16
# Poses that are relaxed in one piece of work, which is kept when it is done.
TOGETHER = 8
# Directions in which the tangents of a pose are learned, this long beside the poses, in energy coordinates.
DIRECTIONS, LENGTH = 4, 0.3
# Perturbed poses: one of these shares of the energy of a pose is added, alike in all directions, but never less than
# `LEAST` of what poses have in the mean, of which `TYPICAL` are looked at.
SHARES, LEAST, TYPICAL = (0.03, 0.1, 0.3, 1.0), 0.1, 40


def condensed_model(
    run: Run, q: Array, recorded: int, displacement: Frames, options: TrainOptions, progress: Progress
) -> StoredModel:
    """Relax training poses and fit a condensed space to them.

    Args:
        q: coordinates of all training poses, (N, k); the first `recorded` are of snapshots.
        displacement: of a pose by its number, (n, 3), metres.

    Raises:
        SettingsError: the run has no condensed space: it is quasi-static, its pins move, or its basis has another inner
            product than the mass.
        SolverError: r is larger than the basis, or too few poses have an equilibrium.
    """
    r = COORDINATES if options.r is None else options.r
    if options.r is None:
        r = min(r, run.basis.k)
    _refuse(run, r)
    relaxation = Relaxation(run.scene, run.basis.columns(r))
    poses = _Poses(relaxation, q[:, :r], displacement, options)
    kept = list(_relaxed(poses, run.folder / "model.partial", progress))
    _tell_lost(poses.wanted, kept, progress)
    slaved = _slaved_basis(kept, run, options.condensed.columns)
    samples = _samples(kept, slaved, relaxation)
    with progress.bar("train", options.condensed.steps, "step") as bar:

        def watch(step: int, loss: float, error: float) -> None:
            bar.say(f"loss {loss:.3f}, force error {error:.4f}")
            bar.reach(step)

        found = fit_condensed(samples, _moduli(run, options), options, watch)
    return _stored(run, found, slaved, q, recorded)


def _refuse(run: Run, r: int) -> None:
    if run.header("snapshots").notes.get("quasistatic", 0):
        raise SettingsError("train.kind is condensed, but the snapshots are quasi-static; a condensed space is stepped")
    if is_identity(run.basis.metric):
        raise SettingsError("train.kind is condensed; it needs pca.inner_product: mass, got euclidean")
    if run.lifting.count:
        raise SettingsError("train.kind is condensed, but pins move; a condensed space needs pins that stand still")
    if r > run.basis.k:
        raise SettingsError(f"train.r is {r}; allowed are 1 … {run.basis.k}, the columns of the basis (pca.k)")


class _Poses:
    """Which poses are relaxed, and the work on one piece of them."""

    def __init__(self, relaxation: Relaxation, z: Array, displacement: Frames, options: TrainOptions) -> None:
        self.relaxation, self.z, self._displacement, self._options = relaxation, z, displacement, options
        rng = np.random.default_rng((options.seed, 0))
        count = min(options.condensed.poses, len(z))
        values, vectors = np.linalg.eigh(relaxation.rest.stiffness)
        self._softest = values[0]
        root = (vectors * np.sqrt(values)) @ vectors.T
        y = z @ root
        # most frames of a motion are near rest, and a run is lost where it is far; who asks for more poses gets a
        # longer prefix of the same order, so only those that are new are relaxed
        self.chosen = farthest_points(y, count)
        size = np.sqrt(np.mean(np.sum(y**2, axis=1)))
        self._to_z = LENGTH * size * np.linalg.inv(root)
        some = [displacement(int(number)).astype(np.float64) for number in rng.permutation(len(z))[:TYPICAL]]
        energies = np.array([add_elastic_gradient(relaxation.scene.elements, u, 0 * u) for u in some])
        # a synthetic pose may be inverted somewhere, where some materials have infinite energy
        self._typical = float(energies[np.isfinite(energies)].sum() / len(energies))

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


def farthest_points(y: Array, count: int) -> NDArray[np.int64]:
    """Numbers of `count` rows of y, (N, r), each the farthest from rest, y = 0, and from those before it."""
    distance, chosen = np.linalg.norm(y, axis=1), np.empty(count, dtype=np.int64)
    for i in range(count):
        chosen[i] = distance.argmax()
        distance = np.minimum(distance, np.linalg.norm(y - y[chosen[i]], axis=1))
        distance[chosen[: i + 1]] = -1.0  # none twice, where frames repeat
    return chosen


class _Piece:
    """The relaxed poses of one piece of work, read from its file when they are asked for."""

    def __init__(self, store: TrainingStore) -> None:
        self._store = store

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


def _relaxed(poses: _Poses, partial: Path, progress: Progress) -> Iterator[_Piece]:
    """All pieces, each kept as soon as it is done; what an earlier run has done is not done again."""
    pieces = range(-(-len(poses.chosen) // TOGETHER))
    stores = [TrainingStore(partial, f"relaxed{piece}", poses.identity(piece)) for piece in pieces]
    with progress.bar("train: relaxed poses", poses.wanted, "pose") as bar:
        todo = [piece for piece in pieces if stores[piece].load() is None]
        _advance(bar, poses, len(pieces) - len(todo))
        for piece, arrays in zip(todo, in_threads(poses.relaxed, todo), strict=True):
            stores[piece].save(arrays)
            _advance(bar, poses, 1)
    yield from map(_Piece, stores)


def _advance(bar: Bar, poses: _Poses, pieces: int) -> None:
    bar.update(min(pieces * TOGETHER * poses.wanted // max(len(poses.chosen), 1), poses.wanted))


def _slaved_basis(pieces: list[_Piece], run: Run, most: int) -> Basis:
    """The leading modes of the slaved parts, orthogonal in the mass to the coordinates' columns."""

    def chunks() -> Iterator[NDArray[np.float32]]:
        yield from (rows for rows in (piece.rows() for piece in pieces) if len(rows))

    found = spectrum(chunks, run.scene.mass, most)
    return leading_modes(chunks, run.scene.mass, min(most, found.independent), found)[0]


def _samples(pieces: list[_Piece], slaved: Basis, relaxation: Relaxation) -> CondensedSamples:
    columns: dict[str, list[Array]] = {}
    for arrays in (piece.read() for piece in pieces):
        along = arrays["along"].astype(np.float64)
        rows = slaved.project(along.reshape(-1, along.shape[2])).reshape(*along.shape[:2], slaved.k)
        projected = {"slaved": slaved.project(arrays["slaved"].astype(np.float64)), "along": rows}
        for name in ("z", "force", "stiffness", "directions", "slaved", "along"):
            columns.setdefault(name, []).append(np.asarray(projected.get(name, arrays[name]), dtype=np.float64))
    joined = {name: np.concatenate(parts) for name, parts in columns.items()}
    rest, r = relaxation.rest, relaxation.r
    tangents = np.ascontiguousarray((rest.tangents.reshape(-1, r) - relaxation.coordinates.matrix).T)
    return CondensedSamples(**joined, rest_stiffness=rest.stiffness, rest_slaved=slaved.project(tangents))


def _tell_lost(wanted: int, pieces: list[_Piece], progress: Progress) -> None:
    stiffness = [np.asarray(piece.read()["stiffness"], dtype=np.float64) for piece in pieces]
    lost = wanted - sum(map(len, stiffness))
    if lost == wanted:
        raise SolverError(
            f"none of {wanted} poses has a stable equilibrium at its coordinates: the solid buckles wherever it was "
            "taken; use a stiffer material, weaker motions, or train.kind: autoencoder"
        )
    if lost:
        progress.tell(
            f"note: {lost} of {wanted} poses have no stable equilibrium at their coordinates (buckled, or too far "
            "from any motion); the model does not learn from them"
        )
    bent = sum(int((np.linalg.eigvalsh(each)[:, 0] < 0).sum()) for each in stiffness if len(each))
    if bent:
        progress.tell(f"note: in {bent} of {wanted} poses the solid buckles as soon as it is let go")


def _moduli(run: Run, options: TrainOptions) -> tuple[NDArray[np.int64], Array, Array]:
    """Points of the mesh whose moduli the virtual points have, with μ and λ there."""
    elements = run.scene.elements
    count = min(options.condensed.points, len(elements.weights))
    points = np.sort(np.random.default_rng((options.seed, 3)).permutation(len(elements.weights))[:count])
    return points, elements.mu[points], elements.lam[points]


def _stored(run: Run, found: Condensed, slaved: Basis, q: Array, recorded: int) -> StoredModel:
    r, k, scene = found.decoder.r, found.decoder.k, run.scene
    V = run.basis.columns(r)
    # V is orthonormal already and comes first, so that only the slaved columns change
    rows = orthonormal_rows(np.hstack([V.matrix, slaved.matrix]).T, scene.mass)
    columns = np.zeros((len(V.matrix), k))
    columns[:, :r], columns[:, k - slaved.k :] = V.matrix, rows[r:].T
    basis = Basis.of(columns, scene.mass)
    networks = found.encoder, found.decoder
    errors = np.array([reconstruction_error(run.chunks(role), basis, *networks) for role in ("train", "validation")])
    return StoredModel(
        decoder=found.decoder,
        encoder=found.encoder,
        loss=found.loss,
        search=np.array([[r, *(1e3 * errors[0])]]),
        errors=errors,
        # by reconstruction a few columns would match, but none of them moves as freely: the rival is the whole basis
        kp=run.basis.k,
        best_epoch=len(found.loss) - 1,
        novelty=fit_novelty(Decoder.identity(r), IDENTITY, q[:, :r], np.empty((0, r))),
        columns=columns,
        potential=found.potential,
    )
