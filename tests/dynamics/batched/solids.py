"""Small solids, decoders and grabs of the batched steppers' tests, and their steps in a row."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from ldsim.arrays import Array
from ldsim.dynamics.batched import BatchedLoads, BatchedState, BatchedStepper
from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.mechanics.grabs import Grab
from ldsim.mechanics.loads import Loads
from ldsim.mechanics.scene import Scene
from ldsim.mesh.shapes import beam
from ldsim.space.decoder import Decoder
from ldsim.space.space import Space
from tests.helpers import reduced_space, scene, smooth_basis

K, R = 6, 3


@cache
def body(material: str = "neo_hookean") -> Scene:
    plain = scene(beam(resolution=1), material=material, youngs_modulus=3e4)
    return replace(plain, load=np.random.default_rng(4).normal(size=plain.mesh.vertices.shape))


@cache
def basis(body: Scene) -> Array:
    return smooth_basis(body, K)


def curved(activation: str = "elu") -> Decoder:
    rng = np.random.default_rng(1)
    weights = [rng.normal(size=(R, 8)), 0.5 * rng.normal(size=(8, 7)), 0.05 * rng.normal(size=(7, K))]
    return Decoder.network(weights, [rng.normal(size=8), rng.normal(size=7), np.zeros(K)], activation, np.eye(R, K))


def batched(some: Scene, decoder: Decoder, **options: object) -> BatchedStepper:
    return BatchedStepper(reduced_space(some, basis(some), decoder), **options)  # type: ignore[arg-type]


def serial(space: Space, tolerance: float = 1e-9) -> ReducedStepper:
    return ReducedStepper(space, ReducedOptions(tolerance=tolerance, max_iterations=500))


def pulls(some: Scene, seed: int) -> Loads:
    """One or two grabs of the free end."""
    rng = np.random.default_rng(seed)
    tips = np.argsort(some.mesh.vertices[:, 0])[-4:]
    chosen = [tips, tips[:2]][: 1 + seed % 2]
    rest = some.mesh.vertices
    return Loads(tuple(Grab(v, rest[v].mean(axis=0) + 0.06 * rng.normal(size=3), 20.0 + 30 * seed) for v in chosen))


def march(stepper: BatchedStepper, loads: BatchedLoads, frames: int) -> BatchedState:
    state = stepper.rest(len(loads.mu))
    for _ in range(frames):
        state, solution = stepper.step(state, loads)
        assert solution.converged.all()
    return state
