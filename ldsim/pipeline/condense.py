"""The condensed latent space of the stage train: poses are relaxed, then potential and decoder are fitted to them."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ldsim.arrays import Array, Indices
from ldsim.artefacts.records import StoredModel
from ldsim.artefacts.training import PARTIAL, TrainingStore
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.dynamics.synthetic import synthetic_frames
from ldsim.errors import SettingsError, SolverError
from ldsim.learn.condensed import Condensed, CondensedSamples, fit_condensed
from ldsim.learn.options import TrainOptions
from ldsim.mechanics.random_pulls import FARTHER, covering_pulls
from ldsim.pipeline.coordinates import combined, needed_coordinates
from ldsim.pipeline.progress import Progress
from ldsim.pipeline.relaxed_poses import ChosenPoses, Frames, Piece, energy_root, farthest_points, relaxed_pieces
from ldsim.pipeline.swing import better_swinging
from ldsim.run import Run
from ldsim.space.basis import Basis, is_identity
from ldsim.space.decoder import Decoder
from ldsim.space.encoder import IDENTITY
from ldsim.space.novelty import fit_novelty
from ldsim.space.pca import orthonormal_rows
from ldsim.space.projection import reconstruction_error
from ldsim.space.relaxation import Relaxation
from ldsim.space.sketch import sketched_modes
from ldsim.space.space import Space

# Begins the seeds of own runs.
OWN = 7
# Pulls of a round's own runs for each pose that is taken of them: to step a pull costs less than to relax a pose.
PULLS = 4
# Before a round the fit has this share of the steps of the last one, and layers at most so wide: where it goes matters,
# not by how much. So wider layers alone come to the same poses, which are relaxed once (`ldsim make --error`).
EXPLORING, NARROW = 0.25, 48
# A symmetric strain's independent entries: fewer points could not tell all coordinates apart.
STRAINS = 6


def condensed_model(run: Run, q: Array, displacement: Frames, options: TrainOptions, progress: Progress) -> StoredModel:
    """Relax training poses and fit a condensed space to them; run it, and learn from where it went, in rounds.

    Args:
        q: coordinates of all training poses, (N, k).
        displacement: of a pose by its number, (n, 3), metres.

    Raises:
        SettingsError: the run has no condensed space: it is quasi-static, its pins move, or its basis has another inner
            product than the mass.
        SolverError: r is larger than the basis, or too few poses have an equilibrium.
    """
    _refuse(run, 1 if options.r is None else options.r)
    chosen = _coordinates(run, options.r, progress)
    r, points = chosen.shape[1], options.condensed.points
    _refuse(run, r)
    if (least := -(-r // STRAINS)) > points:
        raise SettingsError(
            f"train.condensed.points is {points}; allowed are {least} or more, for {r} coordinates have as many strains"
        )
    z = q @ chosen
    work = _Work(run, Relaxation(run.scene, combined(run.basis, chosen)), options, progress)
    work.relax("relaxed", z, displacement, work.poses)
    for number in range(options.condensed.rounds):
        work.explore(number, z)
    work.tell_lost()
    found, basis = work.fit(options.condensed.rounds + 1, options.condensed.steps, options.layers)
    space = Space.condensed(run.scene, basis, (found.decoder, found.encoder), found.potential)
    return _stored(run, better_swinging(run, space, work.relaxation, options.condensed.modes, progress), found.loss, z)


def _coordinates(run: Run, r: int | None, progress: Progress) -> Array:
    """Those that are needed, (k, r), looked for once: what was interrupted goes on from them, as further rounds do."""
    made_from = [run.hash(kind) for kind in ("scene", "snapshots", "basis")]
    digest = hashlib.sha256(repr((made_from, r)).encode()).hexdigest()
    store = TrainingStore(run.folder / PARTIAL, "coordinates", digest)
    kept = store.load()
    if kept is None:
        kept = {"chosen": needed_coordinates(run, r, progress)}
        store.save(kept)
    return np.asarray(kept["chosen"], dtype=np.float64)


class _Work:
    """Poses that are relaxed so far, and fits to them."""

    def __init__(self, run: Run, relaxation: Relaxation, options: TrainOptions, progress: Progress) -> None:
        self.run, self.relaxation, self.options, self.progress = run, relaxation, options, progress
        self.partial = run.folder / PARTIAL
        self.poses, self.explored = options.condensed.relaxed(3 * len(run.scene.free))
        self.wanted, self.pieces = 0, list[Piece]()

    @property
    def z(self) -> Array:
        """Coordinates of all relaxed poses, (m, r)."""
        return np.concatenate([piece.z for piece in self.pieces])

    def relax(self, name: str, z: Array, displacement: Frames, count: int, beside: Array | None = None) -> None:
        """Relax `count` of many poses, and some around them."""
        poses = ChosenPoses(self.relaxation, z, displacement, self.options, count, beside)
        self.wanted += poses.wanted
        self.pieces += relaxed_pieces(poses, self.partial, name, self.progress)
        if not len(self.z):
            raise SolverError(
                f"none of {self.wanted} poses has a stable equilibrium at its coordinates: the solid buckles wherever "
                "it was taken; use a stiffer material, weaker motions, or train.kind: autoencoder"
            )

    def explore(self, number: int, trained: Array) -> None:
        """Run what can be fitted so far under loads like those of the motions, and relax poses that it comes to.

        Args:
            trained: coordinates of all training poses, (N, r). Own pulls go `FARTHER` times as far as theirs, so what
                comes farther than that in the energy norm is a run that is lost in what is not known yet: poses out
                there take longest to relax, and the fit would be good there at the expense of all others.
        """
        have, condensed = self.z, self.options.condensed
        hidden = tuple(min(width, NARROW) for width in self.options.layers)
        # who asks for more rounds, or wider layers, goes on from these
        options = self.options.replace(hidden=hidden, condensed=condensed.replace(rounds=0))
        digest = hashlib.sha256(have.tobytes() + repr((number, options)).encode()).hexdigest()
        store = TrainingStore(self.partial, f"explored{number}", digest)
        kept = store.load()
        if kept is None:
            found, basis = self.fit(number + 1, int(EXPLORING * condensed.steps), hidden)
            space = Space.condensed(self.run.scene, basis, (found.decoder, found.encoder), found.potential)
            root, z = energy_root(self.relaxation), self._own_frames(space, number)
            farthest = FARTHER * np.linalg.norm(trained @ root, axis=1).max()
            z = z[np.linalg.norm(z @ root, axis=1) <= farthest]
            z = z[farthest_points(z @ root, min(self.explored, len(z)), have @ root)]
            kept = {"z": z, "u": np.array([space.displacement(space.decoder(each)) for each in z], dtype=np.float32)}
            store.save(kept)
        u = np.asarray(kept["u"], dtype=np.float64)
        self.relax(f"round {number + 1}", np.asarray(kept["z"], dtype=np.float64), u.__getitem__, self.explored, have)

    def _own_frames(self, space: Space, number: int) -> Array:
        """Coordinates of the frames of its own runs, (f, r)."""
        run, motions = self.run, [self.run.recorded(name).motion for name in self.run.snapshots.with_role("train")]
        count = PULLS * self.explored
        # of its own: with small numbers the pulls would be where those of a configuration's motions are
        seed = int(np.random.SeedSequence((self.options.seed, OWN, number)).generate_state(1)[0])
        pulls = covering_pulls(f"round {number + 1}", run.scene, motions, count, seed)
        with self.progress.bar(f"train: own pulls {number + 1}", pulls.frames, "frame") as bar:
            q = synthetic_frames(ReducedStepper(space), pulls, bar.update, pulls.frames // count)
        return np.ascontiguousarray(q[:, : space.r])  # the decoder gives z back first

    def fit(self, number: int, steps: int, hidden: tuple[int, ...]) -> tuple[Condensed, Basis]:
        """Fit to all poses relaxed so far, for the first, second … time; with the columns that the decoder moves."""
        title = f"train: fit {number} of {self.options.condensed.rounds + 1}"
        with self.progress.bar(title, steps, "step") as bar:
            bar.say("columns of what is slaved")
            slaved = _slaved_basis(self.pieces, self.relaxation, self.options.condensed.columns)

            def watch(step: int, loss: float, error: float) -> None:
                bar.say(f"loss {loss:.3f}, force error {error:.4f}")
                bar.reach(step)

            condensed = self.options.condensed.model_copy(update={"steps": steps})
            options = self.options.model_copy(update={"condensed": condensed, "hidden": hidden})
            samples = _samples(self.pieces, slaved, self.relaxation)
            found = fit_condensed(samples, _moduli(self.run, options), options, watch)
        return found, _columns(self.relaxation.coordinates, found.decoder, slaved)

    def tell_lost(self) -> None:
        """Say how many poses have no sample, and how many buckle."""
        _tell_lost(self.wanted, self.pieces, self.progress)


def _refuse(run: Run, r: int) -> None:
    if run.header("snapshots").notes.get("quasistatic", 0):
        raise SettingsError("train.kind is condensed, but the snapshots are quasi-static; use train.kind: autoencoder")
    if is_identity(run.basis.metric):
        raise SettingsError(
            "train.kind is condensed; it needs pca.inner_product: mass, got euclidean; or use train.kind: autoencoder"
        )
    if run.lifting.count:
        raise SettingsError("train.kind is condensed, but pins move; use train.kind: autoencoder")
    if (run.scene.lam < 0).any():
        raise SettingsError(
            "train.kind is condensed, but a material has a negative Poisson's ratio, of which V_eff is not fitted; "
            "give ratios of 0 or more, or use train.kind: autoencoder"
        )
    if r > run.basis.k:
        raise SettingsError(f"train.r is {r}; allowed are 1 … {run.basis.k}, the columns of the basis (pca.k)")
    if 2 * r >= 3 * len(run.scene.free):
        raise SettingsError(
            f"train.kind is condensed, but the solid has {3 * len(run.scene.free)} unknowns, which leaves nothing "
            f"beside r = {r} coordinates and what they move at rest; use a smaller train.r, a finer mesh, or "
            "train.kind: autoencoder"
        )


def _slaved_basis(pieces: list[Piece], relaxation: Relaxation, most: int) -> Basis:
    """What T₀ moves beside V, exactly, and the leading modes of what slaved parts have beside it; orthonormal.

    Without it in the columns small motions would be right only as far as the modes of large ones reach.
    """
    metric, tangents = relaxation.coordinates.metric, _rest_slaved(relaxation)
    first = sketched_modes(lambda: iter([tangents.astype(np.float32)]), metric, relaxation.r)

    # in float32 as the rows are, which halves the time of all these products
    fields, dual = first.matrix.astype(np.float32), first.dual.astype(np.float32)

    def chunks() -> Iterator[NDArray[np.float32]]:
        for rows in (piece.rows() for piece in pieces):
            if len(rows):
                yield np.subtract(rows, (rows @ dual) @ fields.T, dtype=np.float32)

    modes = sketched_modes(chunks, metric, most)
    both = np.hstack([first.matrix, modes.matrix]).T
    return Basis.of(np.ascontiguousarray(orthonormal_rows(both, metric).T), metric)


def _rest_slaved(relaxation: Relaxation) -> Array:
    """T₀ − V, a row for each coordinate, (r, 3n)."""
    r = relaxation.r
    return np.ascontiguousarray((relaxation.rest.tangents.reshape(-1, r) - relaxation.coordinates.matrix).T)


def _samples(pieces: list[Piece], slaved: Basis, relaxation: Relaxation) -> CondensedSamples:
    columns: dict[str, list[Array]] = {}
    for arrays in (piece.read() for piece in pieces):
        if not len(arrays["z"]):  # every pose of this piece was lost
            continue
        along = arrays["along"].astype(np.float64)
        rows = slaved.project(along.reshape(-1, along.shape[2])).reshape(*along.shape[:2], slaved.k)
        projected = {"slaved": slaved.project(arrays["slaved"].astype(np.float64)), "along": rows}
        for name in ("z", "force", "stiffness", "directions", "slaved", "along"):
            columns.setdefault(name, []).append(np.asarray(projected.get(name, arrays[name]), dtype=np.float64))
    joined = {name: np.concatenate(parts) for name, parts in columns.items()}
    rest_slaved = slaved.project(_rest_slaved(relaxation))
    return CondensedSamples(**joined, rest_stiffness=relaxation.rest.stiffness, rest_slaved=rest_slaved)


def _tell_lost(wanted: int, pieces: list[Piece], progress: Progress) -> None:
    stiffness = [piece.stiffness for piece in pieces]
    lost = wanted - sum(map(len, stiffness))
    if lost:
        progress.tell(
            f"note: {lost} of {wanted} poses have no stable equilibrium at their coordinates (buckled, or too far "
            "from any motion); the model does not learn from them"
        )
    bent = sum(int((np.linalg.eigvalsh(each)[:, 0] < 0).sum()) for each in stiffness if len(each))
    if bent:
        progress.tell(f"note: let go in {bent} of {wanted} poses, the solid would buckle on; these are learned too")


def _moduli(run: Run, options: TrainOptions) -> tuple[Indices, Array, Array]:
    """Points of the mesh whose moduli the virtual points have, with μ and λ there."""
    elements = run.scene.elements
    count = min(options.condensed.points, len(elements.weights))
    points = np.sort(np.random.default_rng((options.seed, 3)).permutation(len(elements.weights))[:count])
    return points, elements.mu[points], elements.lam[points]


def _columns(coordinates: Basis, decoder: Decoder, slaved: Basis) -> Basis:
    """U, (3n, k): V, zeros for the features, and what is slaved."""
    # V is orthonormal already and comes first, so that only the slaved columns change
    rows = orthonormal_rows(np.hstack([coordinates.matrix, slaved.matrix]).T, coordinates.metric)
    columns = np.zeros((rows.shape[1], decoder.k))
    columns[:, : coordinates.k], columns[:, decoder.k - slaved.k :] = coordinates.matrix, rows[coordinates.k :].T
    return Basis.of(columns, coordinates.metric)


def _stored(run: Run, space: Space, loss: Array, z: Array) -> StoredModel:
    r, basis = space.r, space.reduced_basis
    networks = space.encoder, space.decoder
    errors = np.array([reconstruction_error(run.chunks(role), basis, *networks) for role in ("train", "validation")])
    return StoredModel(
        decoder=space.decoder,
        encoder=space.encoder,
        loss=loss,
        search=np.array([[r, *(1e3 * errors[0])]]),
        errors=errors,
        # by reconstruction a few columns would match, but none of them moves as freely: the rival is the whole basis
        kp=run.basis.k,
        best_epoch=len(loss) - 1,
        novelty=fit_novelty(Decoder.identity(r), IDENTITY, z, np.empty((0, r))),
        columns=basis.matrix,
        potential=space.rule,
        squares=space.squares if len(space.squares) else None,
        turns=space.turns,
    )
