"""The plain data types to and from artefacts: scene, basis, model, cubature and simulation."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from ldsim.arrays import Array
from ldsim.artefacts.store import Header, optional, pieces, read_header, reading, write
from ldsim.cubature.path import RulePath, VirtualFit
from ldsim.cubature.rule import CubatureRule
from ldsim.dynamics.trajectory import Trajectory
from ldsim.errors import ArtefactError, SolverError
from ldsim.mechanics.scene import Scene
from ldsim.mesh.mesh import Group, Mesh
from ldsim.space.basis import Basis, inner_product, is_identity
from ldsim.space.decoder import Decoder
from ldsim.space.encoder import Encoder
from ldsim.space.novelty import Novelty
from ldsim.space.pca import Pca


def write_scene(path: Path, header: Header, scene: Scene) -> None:
    """Write scene.h5."""
    points = scene.points
    groups = scene.mesh.groups.items()
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
            "load": scene.load,
            **{f"groups/{name}/vertices": group.vertices for name, group in groups},
            **{f"groups/{name}/cells": group.cells for name, group in groups},
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
            optional(file, "load"),
        )
        return scene, read_header(file)


def write_basis(path: Path, header: Header, pca: Pca) -> None:
    """Write basis.h5; its inner product goes into the header's notes."""
    kind = "euclidean" if is_identity(pca.basis.metric) else "mass"
    datasets = {"U": pca.basis.matrix} | {name: values for name, values in vars(pca).items() if name != "basis"}
    write(path, replace(header, notes={**header.notes, "inner_product": kind}), datasets)


def read_basis(path: Path, scene: Scene) -> tuple[Pca, Header]:
    """Read basis.h5; the inner product is made of the scene's mass."""
    with reading(path, "basis", {"d": 3 * scene.mesh.n_vertices}) as file:
        header = read_header(file)
        metric = inner_product(scene.mass, str(header.notes["inner_product"]))
        basis = Basis.of(file["U"][:], metric)
        return Pca(basis, **{name: data[:] for name, data in file.items() if name != "U"}), header


@dataclass(frozen=True, eq=False)
class StoredModel:
    """model.h5: the latent space, an autoencoder or a condensed one, and how it came about.

    Attributes:
        loss: training and validation loss after each epoch, (epochs, 2).
        search: r, largest and mean training error in mm of each size tried, (tried, 3).
        errors: largest and mean vertex error in metres (columns) on training and validation frames (rows), (2, 2);
            NaN where there are no validation motions.
        kp: the PCA dimension whose largest training error matches the autoencoder's.
        search_own: whether each size tried was a training of its own or the leading codes of an ordered one, (tried,).
        novelty: how far a code is from the training codes.
        columns: the basis of a condensed space, (3n, k): V, the features of V_eff as zeros, and the slaved part.
        potential: the virtual points of V_eff, of a condensed space.
        squares: ω² of the last columns, (m,) 1/s², which are modes that swing beside the coordinates.
        turns: whether what these have of a dent turns with the place that is held.
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
    columns: Array | None = None
    potential: CubatureRule | None = None
    squares: Array | None = None
    turns: bool = False

    @property
    def condensed(self) -> bool:
        """Whether it is of a condensed space."""
        return self.columns is not None

    def __post_init__(self) -> None:
        r, k = self.decoder.r, self.decoder.k
        encoded = (len(self.encoder.weights[0]), self.encoder.weights[-1].shape[1]) if self.encoder.weights else (k, r)
        landmarks = r if self.novelty is None else self.novelty.landmarks.shape[1]
        if (*encoded, landmarks) != (k, r, r) or not 1 <= self.kp <= k:
            raise SolverError(
                f"the decoder goes from r = {r} to k = {k}, the encoder from {encoded[0]} to {encoded[1]}, landmarks "
                f"have {landmarks} numbers, kp is {self.kp}; they do not belong together"
            )


def write_model(path: Path, header: Header, model: StoredModel) -> None:
    """Write model.h5; the activation goes into the header's notes."""
    names = ("loss", "search", "search_own", "errors", "kp", "best_epoch", "columns", "squares")
    datasets = {"skip": model.decoder.skip} | {name: getattr(model, name) for name in names}
    datasets["turns"] = model.turns if model.squares is not None else None
    if model.potential is not None:
        rule = model.potential
        datasets |= {"potential/points": rule.points, "potential/weights": rule.weights}
        datasets |= {"potential/maps": rule.maps, "potential/material": int(rule.material or 0)}
        datasets["potential/errors"] = np.array([rule.training_error, rule.heldout_error])
    if model.novelty is not None:
        datasets |= {f"novelty/{name}": values for name, values in vars(model.novelty).items()}
    for name, network in (("decoder", model.decoder), ("encoder", model.encoder)):
        datasets |= {f"{name}/weights_{i}": weight for i, weight in enumerate(network.weights)}
        datasets |= {f"{name}/biases_{i}": bias for i, bias in enumerate(network.biases)}
    write(path, header, datasets)


def read_model(path: Path) -> tuple[StoredModel, Header]:
    """Read model.h5."""
    with reading(path, "model") as file:
        header = read_header(file)
        activation = str(header.notes["activation"])
        up, down = _layers(file["decoder"]), _layers(file["encoder"])
        model = StoredModel(
            Decoder.network(*up, activation=activation, skip=optional(file, "skip")),
            Encoder(tuple(down[0]), tuple(down[1]), activation),
            file["loss"][:],
            file["search"][:],
            file["errors"][:],
            int(file["kp"][()]),
            int(file["best_epoch"][()]),
            optional(file, "search_own"),
            _novelty(file["novelty"]) if "novelty" in file else None,
            optional(file, "columns"),
            _potential(file["potential"]) if "potential" in file else None,
            optional(file, "squares"),
            bool("turns" in file and file["turns"][()]),
        )
        return model, header


def _novelty(group: h5py.Group) -> Novelty:
    return Novelty(group["landmarks"][:], float(group["reach"][()]), float(group["threshold"][()]))


def _potential(group: h5py.Group) -> CubatureRule:
    training, heldout = (float(error) for error in group["errors"][:])
    points, weights, maps = (group[name][:] for name in ("points", "weights", "maps"))
    return CubatureRule(points, weights, training, maps, heldout, material=int(group["material"][()]))


def _layers(group: h5py.Group) -> tuple[list[Array], list[Array]]:
    layers = range((len(group) + 1) // 2)
    return [group[f"weights_{i}"][:] for i in layers], [group[f"biases_{i}"][:] for i in layers]


def write_cubature(path: Path, header: Header, spaces: dict[str, RulePath]) -> None:
    """Write cubature.h5 with one group a space."""
    datasets: dict[str, Any] = {}
    for space, found in spaces.items():
        rules = found.rules
        stored = {
            "chosen": found.chosen,
            "path_sizes": np.array([len(rule.points) for rule in rules], dtype=np.int64),
            "path_errors": np.array([[rule.training_error, rule.heldout_error] for rule in rules]),
            "path_perturbed_errors": np.array([rule.perturbed_error for rule in rules]),
            "path_points": np.concatenate([rule.points for rule in rules]),
            "path_weights": np.concatenate([rule.weights for rule in rules]),
        }
        if found.virtual is not None:
            rule = found.virtual.rule
            errors = np.array([rule.training_error, rule.heldout_error, rule.perturbed_error])
            stored |= {"virtual_points": rule.points, "virtual_weights": rule.weights, "virtual_maps": rule.maps}
            stored |= {"virtual_errors": errors, "virtual_closure": found.virtual.closure}
            stored |= {"virtual_judged": found.virtual.judged, "virtual_material": rule.material}
        datasets |= {f"{space}/{name}": values for name, values in stored.items()}
    write(path, header, datasets)


def read_cubature(path: Path, sizes: Mapping[str, int] | None = None) -> tuple[dict[str, RulePath], Header]:
    """Read cubature.h5; `sizes` may hold s, the scene's quadrature points."""
    with reading(path, "cubature", sizes) as file:
        lacking = [space for space in ("latent", "linear") if space not in file]
        if lacking:
            name = f"{lacking[0]}/path_points"
            raise ArtefactError(f"{path} lacks the dataset {name!r}; it is damaged, delete it and run make")
        other = [space for space in file if not re.fullmatch(r"latent|linear(_[1-9]\d{0,8})?", space)]
        if other:
            raise ArtefactError(f"{path} has rules of {other[0]!r}, which is no space; delete it and run make")
        spaces = {space: _rule_path(file[space]) for space in file}
        return spaces, read_header(file)


def _rule_path(group: h5py.Group) -> RulePath:
    errors = np.column_stack([group["path_errors"][:], group["path_perturbed_errors"][:]])
    points, weights = (pieces(group[f"path_{name}"][:], group["path_sizes"][:]) for name in ("points", "weights"))
    rules = tuple(
        CubatureRule(p, w, float(training), None, float(heldout), float(perturbed))
        for p, w, (training, heldout, perturbed) in zip(points, weights, errors, strict=True)
    )
    return RulePath(rules, int(group["chosen"][()]), _virtual(group))


def _virtual(group: h5py.Group) -> VirtualFit | None:
    if "virtual_points" not in group:
        return None
    training, heldout, perturbed = (float(error) for error in group["virtual_errors"][:])
    points, weights, maps = (group[f"virtual_{name}"][:] for name in ("points", "weights", "maps"))
    material = int(group["virtual_material"][()]) if "virtual_material" in group else None
    rule = CubatureRule(points, weights, training, maps, heldout, perturbed, material)
    return VirtualFit(rule, float(group["virtual_closure"][()]), group["virtual_judged"][:])


Runs = Mapping[str, Mapping[str, Trajectory]]
Fresh = Mapping[str, Array]


def write_simulation(path: Path, header: Header, runs: Runs, fresh: Fresh | None = None) -> None:
    """Write simulation.h5 from space → motion → trajectory, and space → online errors of fresh motions."""
    datasets = {f"fresh/{name}": errors for name, errors in (fresh or {}).items()}
    for space, motions in runs.items():
        for motion, trajectory in motions.items():
            datasets |= {f"runs/{space}/{motion}/{name}": values for name, values in vars(trajectory).items()}
    write(path, header, datasets)


def read_simulation(path: Path) -> tuple[dict[str, dict[str, Trajectory]], Header]:
    """Read simulation.h5."""
    with reading(path, "simulation") as file:
        runs = {
            space: {motion: _trajectory(group) for motion, group in motions.items()}
            for space, motions in file["runs"].items()
        }
        return runs, read_header(file)


def read_fresh(path: Path) -> dict[str, Array]:
    """Space → online errors of the fresh motions; empty where there were none."""
    with reading(path, "simulation") as file:
        return {space: data[:] for space, data in file["fresh"].items()} if "fresh" in file else {}


def _trajectory(group: h5py.Group) -> Trajectory:
    return Trajectory(**{name: data[:] for name, data in group.items()})
