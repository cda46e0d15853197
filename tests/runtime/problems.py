"""Small models of every kind, and motions that pull, let go, tip gravity and move pins."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ldsim.cubature.rule import CubatureRule
from ldsim.mechanics.grabs import Grab
from ldsim.mechanics.loads import Loads
from ldsim.mechanics.materials import MATERIALS, material_number
from ldsim.mechanics.motion import Motion, Support
from ldsim.mechanics.pins import MovedPins
from ldsim.mechanics.scene import Scene
from ldsim.mesh.shapes import beam
from ldsim.space.activation import ACTIVATIONS
from ldsim.space.anchors import Anchors
from ldsim.space.basis import Basis
from ldsim.space.decoder import Decoder
from ldsim.space.encoder import IDENTITY
from ldsim.space.lifting import Lifting
from ldsim.space.modes import slowest_modes
from ldsim.space.novelty import Novelty
from ldsim.space.pca import orthonormal_rows
from ldsim.space.relaxation import Relaxation
from ldsim.space.space import Space
from tests.helpers import reduced_space, scene, smooth_basis

K, R = 6, 4


def body(material: str = "neo_hookean", resolution: int = 1) -> Scene:
    """A beam with a dead load that differs from vertex to vertex, pinned at its left."""
    solid = scene(beam(resolution=resolution), material, youngs_modulus=5e4)
    load = np.random.default_rng(2).normal(size=solid.mesh.vertices.shape)
    return replace(solid, load=load * 0.3 * np.abs(solid.external_force).max())


def curved(activation: str = "elu", skip: bool = True, layers: int = 2) -> Decoder:
    """A decoder that bends; without a skip, or with one layer alone, it is as the paper's."""
    rng = np.random.default_rng(1)
    widths = [R, *[8] * (layers - 1), K]
    weights = [rng.normal(size=pair) for pair in zip(widths, widths[1:], strict=False)]
    weights[-1] *= 0.02 if skip else 0.1
    biases = [rng.normal(size=width) for width in widths[1:]]
    return Decoder.network(weights, biases, activation, np.eye(R, K) if skip else None)


def thinned(solid: Scene) -> CubatureRule:
    """Every third quadrature point, in place of its neighbours."""
    points = np.arange(0, solid.points.n_points, 3)
    return CubatureRule(points, 3 * solid.points.weights[points], 0.0)


def one_unit() -> Decoder:
    """A skip, and beside it one unit in the last hidden layer."""
    rng = np.random.default_rng(7)
    weights = [rng.normal(size=(R, 8)), rng.normal(size=(8, 1)), 0.02 * rng.normal(size=(1, K))]
    return Decoder.network(weights, [rng.normal(size=8), rng.normal(size=1), np.zeros(K)], "elu", np.eye(R, K))


def narrow() -> Decoder:
    """Nearly linear, and with so narrow a last hidden layer that the library's models do without the last one."""
    rng = np.random.default_rng(6)
    there = np.concatenate([np.eye(R), 0.5 * rng.normal(size=(R, R))], axis=1)
    back = np.concatenate([np.eye(R), 0.3 * rng.normal(size=(R, R))], axis=0)
    biases = [0.3 * rng.normal(size=2 * R), 0.3 * rng.normal(size=R), rng.normal(size=K)]
    return Decoder.network([there, back, np.eye(R, K) + 0.2 * rng.normal(size=(R, K))], biases, "tanh")


def latent(material: str = "neo_hookean", decoder: Decoder | None = None) -> Space:
    solid = body(material)
    rng = np.random.default_rng(5)
    novelty = Novelty(0.01 * rng.normal(size=(12, R)), 0.02, 1.5)
    space = reduced_space(solid, smooth_basis(solid, K), curved() if decoder is None else decoder, thinned(solid))
    return replace(space, novelty=novelty)


def linear(material: str = "neo_hookean") -> Space:
    solid = body(material)
    return reduced_space(solid, smooth_basis(solid, K), None, thinned(solid))


def mixed(decoder: Decoder | None = None) -> Space:
    """Two materials, whose points alternate until they are sorted, and a basis that is not orthonormal in the mass."""
    solid = body()
    material = solid.material.copy()
    material[::2] = material_number("stable_neo_hookean")
    solid = replace(solid, material=material)
    U = smooth_basis(solid, K) @ (np.eye(K) + 0.2 * np.random.default_rng(3).normal(size=(K, K)))
    return reduced_space(solid, U, curved() if decoder is None else decoder, thinned(solid))


def condensed(material: str = "neo_hookean", modes: int = 0, width: int = 8, turns: bool = True) -> Space:
    """z, functions of it that virtual points see, and slaved coordinates that they do not, of which some may swing."""
    solid = body(material, resolution=2)  # so large that its factor has several supernodes
    U, squares = smooth_basis(solid, R + 2), np.empty(0)
    if modes:
        found = slowest_modes(Relaxation(solid, Basis.of(U[:, :R], solid.mass)), modes)
        rows = orthonormal_rows(np.hstack([U[:, :R], found.fields.reshape(len(U), -1), U[:, R:]]).T, solid.mass)
        U, squares = np.concatenate([rows[:R], rows[R + modes :], rows[R : R + modes]]).T, found.squares
    columns = np.concatenate([U[:, :R], np.zeros((len(U), 3)), U[:, R:]], axis=1)
    basis = Basis.of(columns, solid.mass)
    rng, k = np.random.default_rng(4), R + 5 + modes
    layers = [rng.normal(size=(R, width)), rng.normal(size=(width, k)) * 0.02]
    layers[1][:, :R] = 0.0
    decoder = Decoder.network(layers, [rng.normal(size=width), np.zeros(k)], "tanh", np.eye(R, k))
    points = np.arange(0, solid.points.n_points, 11)
    maps, weights = np.zeros((len(points), 9, k)), 11 * solid.points.weights[points]
    stiff = CubatureRule(points, weights, 0.0).strain_maps(solid, columns)
    maps[:, :, :R] = stiff[:, :, :R]
    maps[:, :, R : R + 3] = rng.normal(size=(len(points), 9, 3)) * np.abs(stiff).mean()
    number = material_number(material)
    rule = CubatureRule(points, weights, 0.0, maps, material=number)
    return Space.condensed(solid, basis, (decoder, IDENTITY), rule, squares, turns)


def with_linear_dents(material: str = "neo_hookean", modes: int = 0, turns: bool = True) -> Space:
    """A condensed space whose compliance is kept at anchors, as many as free vertices, as the C library has it."""
    space = condensed(material, modes, turns=turns)
    assert space.compliance is not None
    return replace(space, compliance=space.compliance.anchored())


def anchored(space: Space, count: int = 30) -> Space:
    """A condensed space whose compliance is kept at fewer anchors than it has free vertices."""
    assert space.compliance is not None and count < len(space.scene.free) / 2
    anchors = Anchors.of(space.scene, space.compliance.local, count)
    return replace(space, compliance=space.compliance.anchored(anchors))


def with_moving_pins(decoder: Decoder | None = None) -> Space:
    space = latent(decoder=decoder)
    solid = space.scene
    held = np.flatnonzero(solid.pinned)
    steps = np.tile(np.eye(3, 4), (2, 1, 1))
    halves = held[: len(held) // 2], held[len(held) // 2 :]
    motion = Motion("move", 2, (), None, tuple(Support(half, steps) for half in halves))
    return space.with_lifting(Lifting.of(solid, [motion]))


SPACES: dict[str, Callable[[], Space]] = {f"latent {name}": partial(latent, name) for name in MATERIALS}
SPACES |= {f"linear {name}": partial(linear, name) for name in MATERIALS}
SPACES |= {f"condensed {name}": partial(with_linear_dents, name) for name in MATERIALS}
SPACES |= {
    "condensed at few anchors": lambda: anchored(condensed()),
    "condensed, modes that swing": lambda: with_linear_dents(modes=4, turns=False),
    "condensed, modes that turn": lambda: with_linear_dents(modes=4),
    "condensed, modes that swing, a narrow layer": lambda: anchored(condensed(modes=9, width=1)),
}
SPACES |= {f"latent {name}": partial(latent, decoder=curved(name)) for name in ACTIVATIONS}
SPACES |= {
    "latent without skip": lambda: latent(decoder=curved(skip=False)),
    "latent of one layer": lambda: latent(decoder=curved(layers=1)),
    "latent of four layers": lambda: latent(decoder=curved(layers=4)),
    "latent of two materials": mixed,
    "latent with a narrow layer": lambda: latent(decoder=narrow()),
    "latent with moving pins": with_moving_pins,
    "latent with a narrow layer and two materials": lambda: mixed(narrow()),
    "latent with a skip and one unit": lambda: latent(decoder=one_unit()),
    "latent with a narrow layer and moving pins": lambda: with_moving_pins(narrow()),
}


def loads(space: Space, frames: int) -> Iterator[Loads]:
    """Two grabs that come, drag, overlap and go again and again; gravity that tips; pins that rock."""
    solid = space.scene
    x, reach = solid.mesh.vertices, 0.25 * solid.mesh.diagonal
    tip = np.flatnonzero(x[:, 0] > x[:, 0].max() - 1e-9)
    middle = np.flatnonzero(np.abs(x[:, 0] - x[:, 0].mean()) < 0.2 * np.ptp(x[:, 0]))[:5]
    for frame in range(frames):
        t = frame * solid.time_step
        grabs = []
        for held, start, stop, k in ((tip, 10, 70, 500.0), (middle, 50, 90, 300.0)):
            if start <= frame % 120 < stop:
                way = reach * np.array([0.2 * np.sin(3 * t), np.sin(7 * t), 0.6 * np.cos(5 * t)])
                grabs.append(Grab(held, x[held].mean(axis=0) + way, k))
        angle = 0.5 * np.sin(t)
        gravity = np.array([0.0, -9.81 * np.cos(angle), 9.81 * np.sin(angle)]) if frame % 200 > 100 else None
        yield Loads(tuple(grabs), gravity, _rocking(space, t))


def _rocking(space: Space, t: float) -> tuple[MovedPins, ...]:
    if space.lifting is None:
        return ()
    low, high = space.lifting.supports
    map: NDArray[np.float64] = np.eye(3, 4)
    map[1, 0], map[1, 3] = 0.1 * np.sin(4 * t), 0.01 * np.sin(6 * t)
    return (MovedPins(low, map), MovedPins(high, map)) if t > 0.1 else ()
