"""The artefacts of a run that can be simulated: a small beam, smooth modes, a curved decoder, every point."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from ldsim.arrays import Array
from ldsim.artefacts.records import StoredModel, write_basis, write_cubature, write_model, write_scene
from ldsim.artefacts.store import STAGE_OF, Header, file_hash
from ldsim.cubature.path import RulePath, VirtualFit
from ldsim.cubature.rule import CubatureRule
from ldsim.mechanics.scene import Scene
from ldsim.mesh.shapes import beam
from ldsim.space.basis import Basis, inner_product
from ldsim.space.decoder import Decoder
from ldsim.space.encoder import Encoder
from ldsim.space.pca import Pca, orthonormalised
from tests.helpers import scene

K, R, KP = 9, 4, 6


def solid(resolution: int = 2) -> Scene:
    """A beam of rubber, pinned where x is smallest."""
    return scene(beam(length=0.25, resolution=resolution), youngs_modulus=3e4)


def modes(body: Scene, k: int = K) -> Array:
    """Smooth mass-orthonormal fields that vanish at the pins, (3n, k)."""
    x = body.mesh.vertices / np.ptp(body.mesh.vertices[:, 0])
    s = x[:, 0] - x[:, 0].min()
    fields = np.zeros((body.mesh.n_vertices, 3, k))
    for j in range(k):
        fields[:, (1, 2, 0)[j % 3], j] = s ** (1 + (j // 3)) * (1 + x[:, 1] * (j >= 3))
    return orthonormalised(fields.reshape(-1, k), inner_product(body.mass, "mass")).matrix


def curved_decoder(k: int = K, r: int = R) -> Decoder:
    """q_i = (e(10 zᵢ) − e(−10 zᵢ))/20 for i < r with e the activation: the first modes, which bend into the others."""
    into = np.hstack([np.eye(r), -np.eye(r)]) * 10
    out = np.vstack([np.eye(r, k), -np.eye(r, k)]) / 20
    out += 0.01 * np.vstack([np.eye(r, k, r)] * 2)
    return Decoder.network([into, out], [np.zeros(2 * r), np.zeros(k)], "elu")


def write_playable(folder: Path) -> None:
    """Write scene, basis, model and cubature into a folder."""
    body = solid(1)
    write_scene(folder / "scene.h5", header(folder, "scene"), body)
    U, error = modes(body), np.geomspace(0.1, 1e-4, K + 1)
    write_basis(folder / "basis.h5", header(folder, "basis"), Pca(Basis.of(U, body.mass), error[:K], error, error))
    decoder = curved_decoder()
    encoder = Encoder((np.eye(K, R),), (np.zeros(R),))
    model = StoredModel(decoder, encoder, np.ones((1, 2)), np.ones((1, 3)), np.ones((2, 2)), KP, 0)
    write_model(folder / "model.h5", header(folder, "model", activation="elu"), model)
    points = body.points
    rules = tuple(
        CubatureRule(np.arange(points.n_points)[::stride], stride * points.weights[::stride], 0.0) for stride in (4, 1)
    )
    stored = RulePath(rules, 1)
    maps = rules[0].strain_maps(body, U)
    maps *= np.random.default_rng(3).uniform(0.9, 1.1, maps.shape)
    virtual = VirtualFit(replace(rules[0], maps=maps), 1.0, np.array([[np.nan, 0.2], [1.0, 0.1]]))
    spaces = {"latent": replace(stored, virtual=virtual), "linear": stored}
    write_cubature(folder / "cubature.h5", header(folder, "cubature"), spaces)


def header(folder: Path, kind: str, **notes: str) -> Header:
    """A header with the hashes of everything that earlier stages have written."""
    kinds = list(STAGE_OF)
    earlier = [name for name in kinds[: kinds.index(kind)] if (folder / f"{name}.h5").is_file()]
    inputs = {name: file_hash(folder / f"{name}.h5") for name in earlier}
    return Header(kind, "", inputs, 0, {"experiment": "playable", "stage": STAGE_OF[kind], **notes})
