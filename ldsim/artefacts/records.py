"""The plain data types to and from artefacts: scene, basis, model and cubature."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from ldsim.artefacts.store import Header, read_header, reading, write
from ldsim.cubature.ladder import VirtualSelection
from ldsim.cubature.rule import CubatureRule
from ldsim.errors import ArtefactError
from ldsim.mechanics.scene import Scene
from ldsim.mesh.mesh import Group, Mesh
from ldsim.space.basis import Basis, inner_product, is_identity
from ldsim.space.decoder import Decoder
from ldsim.space.encoder import Encoder
from ldsim.space.novelty import Novelty
from ldsim.space.pca import Pca

Array = NDArray[np.float64]


def write_scene(path: Path, header: Header, scene: Scene) -> None:
    """Write scene.h5."""
    points = scene.points
    optional: dict[str, NDArray[np.generic]] = {} if scene.load is None else {"load": scene.load}
    for name, group in scene.mesh.groups.items():
        optional[f"groups/{name}/vertices"], optional[f"groups/{name}/cells"] = group.vertices, group.cells
    write(
        path,
        header,
        {
            "mesh/vertices": scene.mesh.vertices,
            "mesh/cells": scene.mesh.cells,
            "quadrature/nodes": points.nodes,
            "quadrature/gradients": points.gradients,
            "quadrature/weights": points.weights,
            "quadrature/cells": points.cells,
            "material/kind": scene.material,
            "material/mu": scene.mu,
            "material/lam": scene.lam,
            "material/density": scene.density,
            "pinned": scene.pinned,
            "gravity": scene.gravity,
            "time_step": np.float64(scene.time_step),
            **optional,
        },
    )


def read_scene(path: Path) -> tuple[Scene, Header]:
    """Read scene.h5; the quadrature is made anew from the mesh."""
    with reading(path, "scene") as file:
        cells = file["mesh/cells"][:]
        stored = file["groups"].items() if "groups" in file else ()
        groups = {name: Group(group["vertices"][:], group["cells"][:]) for name, group in stored}
        mesh = Mesh(file["mesh/vertices"][:], cells, "tet4" if cells.shape[1] == 4 else "hex8", groups)
        scene = Scene(
            mesh,
            file["material/kind"][:],
            file["material/mu"][:],
            file["material/lam"][:],
            file["material/density"][:],
            file["pinned"][:],
            file["gravity"][:],
            float(file["time_step"][()]),
            file["load"][:] if "load" in file else None,
        )
        return scene, read_header(file)


def write_basis(path: Path, header: Header, pca: Pca) -> None:
    """Write basis.h5; its inner product goes into the header's notes."""
    kind = "euclidean" if is_identity(pca.basis.metric) else "mass"
    datasets = {
        "U": pca.basis.matrix,
        "singular_values": pca.singular_values,
        "max_error": pca.max_error,
        "mean_error": pca.mean_error,
    }
    if pca.heldout_max_error is not None and pca.heldout_mean_error is not None:
        datasets["heldout_max_error"] = pca.heldout_max_error
        datasets["heldout_mean_error"] = pca.heldout_mean_error
    write(path, replace(header, notes={**header.notes, "inner_product": kind}), datasets)


def read_basis(path: Path, scene: Scene) -> tuple[Pca, Header]:
    """Read basis.h5; the inner product is made of the scene's mass."""
    with reading(path, "basis") as file:
        header = read_header(file)
        metric = inner_product(scene.mass, str(header.notes["inner_product"]))
        if len(file["U"]) != 3 * scene.mesh.n_vertices:
            raise ArtefactError(
                f"{path}, dataset 'U': found {len(file['U'])} rows, expected 3 × {scene.mesh.n_vertices} vertices; "
                "it belongs to another mesh: run make"
            )
        basis = Basis.of(file["U"][:], metric)
        found = [file[name][:] for name in ("singular_values", "max_error", "mean_error")]
        heldout = [file[name][:] if name in file else None for name in ("heldout_max_error", "heldout_mean_error")]
        return Pca(basis, *found, *heldout), header


@dataclass(frozen=True, eq=False)
class StoredModel:
    """model.h5: the autoencoder and how it came about.

    Attributes:
        loss: training and validation loss after each epoch, (epochs, 2).
        search: r, largest and mean training error in mm of each size tried, (tried, 3).
        errors: largest and mean vertex error in metres (columns) on training and held-out frames (rows), (2, 2); NaN
            where there are no held-out motions.
        kp: the PCA dimension whose largest training error matches the autoencoder's.
        search_own: whether each size tried was a training of its own or the leading codes of an ordered one, (tried,).
        novelty: how far a code is from the training codes.
        synthetic: coordinates of the frames of synthetic motions that were learned from too, (f, k) float32, or None.
    """

    decoder: Decoder
    encoder: Encoder
    loss: Array
    search: Array
    errors: Array
    kp: int
    best_epoch: int
    search_own: NDArray[np.bool_] | None = None
    novelty: Novelty | None = None
    synthetic: NDArray[np.float32] | None = None


def write_model(path: Path, header: Header, model: StoredModel) -> None:
    """Write model.h5; the activation goes into the header's notes."""
    datasets: dict[str, NDArray[np.generic] | float | int] = {
        "loss": model.loss,
        "search": model.search,
        "errors": model.errors,
        "kp": model.kp,
        "best_epoch": model.best_epoch,
    }
    if model.decoder.skip is not None:
        datasets["skip"] = model.decoder.skip
    if model.search_own is not None:
        datasets["search_own"] = model.search_own
    if model.synthetic is not None:
        datasets["synthetic"] = model.synthetic
    if model.novelty is not None:
        datasets |= {"novelty/landmarks": model.novelty.landmarks, "novelty/reach": model.novelty.reach}
        datasets["novelty/threshold"] = model.novelty.threshold
    for i, (weight, bias) in enumerate(zip(model.decoder.weights, model.decoder.biases, strict=True)):
        datasets[f"decoder/weights_{i}"], datasets[f"decoder/biases_{i}"] = weight, bias
    for i, (weight, bias) in enumerate(zip(model.encoder.weights, model.encoder.biases, strict=True)):
        datasets[f"encoder/weights_{i}"], datasets[f"encoder/biases_{i}"] = weight, bias
    write(path, header, datasets)


def read_model(path: Path) -> tuple[StoredModel, Header]:
    """Read model.h5."""
    with reading(path, "model") as file:
        header = read_header(file)
        activation = str(header.notes["activation"])
        up, down = _layers(file["decoder"]), _layers(file["encoder"])
        skip = file["skip"][:] if "skip" in file else None
        model = StoredModel(
            Decoder.network(*up, activation=activation, skip=skip),
            Encoder(tuple(down[0]), tuple(down[1]), activation),
            file["loss"][:],
            file["search"][:],
            file["errors"][:],
            int(file["kp"][()]),
            int(file["best_epoch"][()]),
            file["search_own"][:] if "search_own" in file else None,
            _novelty(file["novelty"]) if "novelty" in file else None,
            file["synthetic"][:] if "synthetic" in file else None,
        )
        return model, header


def _novelty(group: h5py.Group) -> Novelty:
    return Novelty(group["landmarks"][:], float(group["reach"][()]), float(group["threshold"][()]))


def _layers(group: h5py.Group) -> tuple[list[Array], list[Array]]:
    layers = range((len(group) + 1) // 2)
    return [group[f"weights_{i}"][:] for i in layers], [group[f"biases_{i}"][:] for i in layers]


@dataclass(frozen=True, eq=False)
class StoredCubature:
    """The cubature of one space: its ladder of sets with their held-out errors, and the set that was chosen.

    Attributes:
        ladder: from the smallest set to the largest.
        heldout_errors: relative error of each on held-out poses, (l,).
        chosen: index of the set in the ladder.
        perturbed_errors: relative error of each on perturbed poses, (l,); None where it was not measured.
        virtual: virtual points, fitted from a set of the ladder; None where there are none.
    """

    ladder: tuple[CubatureRule, ...]
    heldout_errors: Array
    chosen: int
    perturbed_errors: Array | None = None
    virtual: VirtualSelection | None = None

    @property
    def best(self) -> CubatureRule:
        """The chosen set of the ladder, on the mesh."""
        return self.ladder[self.chosen]

    @property
    def stepped(self) -> CubatureRule:
        """What a step takes unless told otherwise: the virtual points, or else the chosen set."""
        return self.best if self.virtual is None else self.virtual.cubature

    def at_most(self, points: int) -> CubatureRule:
        """The largest set of at most so many points."""
        fitting = [entry for entry in self.ladder if len(entry.points) <= points]
        return fitting[-1] if fitting else self.ladder[0]


def write_cubature(path: Path, header: Header, spaces: dict[str, StoredCubature]) -> None:
    """Write cubature.h5 with one group a space."""
    datasets: dict[str, NDArray[np.generic] | float | int] = {}
    for space, stored in spaces.items():
        errors = np.array([entry.training_error for entry in stored.ladder])
        datasets[f"{space}/points"] = stored.best.points
        datasets[f"{space}/weights"] = stored.best.weights
        datasets[f"{space}/errors"] = np.array([errors[stored.chosen], stored.heldout_errors[stored.chosen]])
        datasets[f"{space}/ladder_sizes"] = np.array([len(entry.points) for entry in stored.ladder], dtype=np.int64)
        datasets[f"{space}/ladder_errors"] = np.column_stack([errors, stored.heldout_errors])
        if stored.perturbed_errors is not None:
            datasets[f"{space}/ladder_perturbed_errors"] = stored.perturbed_errors
        datasets[f"{space}/ladder_points"] = np.concatenate([entry.points for entry in stored.ladder])
        datasets[f"{space}/ladder_weights"] = np.concatenate([entry.weights for entry in stored.ladder])
        if stored.virtual is not None:
            found = stored.virtual.cubature
            assert found.maps is not None
            errors = np.array([found.training_error, stored.virtual.heldout_error, stored.virtual.perturbed_error])
            datasets |= {f"{space}/virtual_points": found.points, f"{space}/virtual_weights": found.weights}
            datasets |= {f"{space}/virtual_maps": found.maps, f"{space}/virtual_errors": errors}
            datasets |= {
                f"{space}/virtual_closure": stored.virtual.closure,
                f"{space}/virtual_tried": stored.virtual.tried,
            }
    write(path, header, datasets)


def read_cubature(path: Path) -> tuple[dict[str, StoredCubature], Header]:
    """Read cubature.h5."""
    with reading(path, "cubature") as file:
        lacking = [space for space in ("latent", "linear") if space not in file]
        if lacking:
            name = f"{lacking[0]}/points"
            raise ArtefactError(f"{path} lacks the dataset {name!r}; it is damaged, delete it and run make")
        spaces = {space: _stored_cubature(file[space]) for space in file}
        return spaces, read_header(file)


def _stored_cubature(group: h5py.Group) -> StoredCubature:
    sizes, errors = group["ladder_sizes"][:], group["ladder_errors"][:]
    points = np.split(group["ladder_points"][:], np.cumsum(sizes)[:-1])
    weights = np.split(group["ladder_weights"][:], np.cumsum(sizes)[:-1])
    ladder = tuple(CubatureRule(p, w, float(e)) for p, w, e in zip(points, weights, errors[:, 0], strict=True))
    chosen = [
        i
        for i, entry in enumerate(ladder)
        if np.array_equal(entry.points, group["points"][:]) and np.array_equal(entry.weights, group["weights"][:])
    ]
    perturbed = group["ladder_perturbed_errors"][:] if "ladder_perturbed_errors" in group else None
    return StoredCubature(ladder, errors[:, 1], chosen[0], perturbed, _virtual(group))


def _virtual(group: h5py.Group) -> VirtualSelection | None:
    if "virtual_points" not in group:
        return None
    training, heldout, perturbed = (float(error) for error in group["virtual_errors"][:])
    points, weights, maps = (group[f"virtual_{name}"][:] for name in ("points", "weights", "maps"))
    closure, tried = float(group["virtual_closure"][()]), group["virtual_tried"][:]
    return VirtualSelection(CubatureRule(points, weights, training, maps), heldout, perturbed, closure, tried)
