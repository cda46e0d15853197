"""Small solids, spaces and loads that the tests of reduced stepping share."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ldsim.dynamics.full.options import FullOptions
from ldsim.dynamics.full.stepper import FullStepper
from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.state import ReducedState
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.mechanics.grabs import Grab
from ldsim.mechanics.loads import Loads
from ldsim.mechanics.motion import Motion, Support
from ldsim.mechanics.pins import MovedPins
from ldsim.mechanics.scene import Scene
from ldsim.mesh.shapes import beam
from ldsim.optimise.solution import Reason
from ldsim.space.basis import inner_product
from ldsim.space.decoder import Decoder
from ldsim.space.lifting import Lifting
from ldsim.space.pca import orthonormalised
from tests.helpers import reduced_space, scene, unit_basis

Array = NDArray[np.float64]

TET = scene(beam(resolution=1), youngs_modulus=3e4)
HEX = scene(beam(resolution=1, cell_type="hex8"), youngs_modulus=3e4)


def full_basis(body: Scene) -> Array:
    """Every displacement of the free vertices, mass-orthonormal, (3n, 3f)."""
    return orthonormalised(unit_basis(body), inner_product(body.mass, "mass")).matrix


def curved(k: int, r: int) -> Decoder:
    rng = np.random.default_rng(1)
    weights = [rng.normal(size=(r, 8)), rng.normal(size=(8, k)) * 0.02]
    return Decoder.network(weights, [rng.normal(size=8), np.zeros(k)], "elu", np.eye(r, k))


def stepper(
    body: Scene, U: Array, decoder: Decoder, lifting: Lifting | None = None, **options: object
) -> ReducedStepper:
    wanted = {"tolerance": 1e-8, "max_iterations": 500} | options
    return ReducedStepper(reduced_space(body, U, decoder, lifting=lifting), ReducedOptions(**wanted))  # type: ignore[arg-type]


def full_stepper(body: Scene) -> FullStepper:
    return FullStepper(body, FullOptions(tolerance=1e-9))


def pull(body: Scene, amount: float = 0.05) -> Loads:
    tip = np.argsort(body.mesh.vertices[:, 0])[-4:]
    return Loads((Grab(tip, body.mesh.vertices[tip].mean(axis=0) + [0, amount, amount / 2], 40.0),))


def run(some: ReducedStepper, loads: Loads, frames: int) -> list[ReducedState]:
    states = [some.rest()]
    for _ in range(frames):
        state, solution = some.step(states[-1], loads)
        assert solution.reason == Reason.CONVERGED
        states.append(state)
    return states[1:]


def shaken(body: Scene, frames: int, seed: int = 5) -> Motion:
    """All pins carried and turned along a crooked path."""
    rng = np.random.default_rng(seed)
    maps = np.eye(3, 4) + np.cumsum(rng.normal(size=(frames, 3, 4)) * [0.02, 0.02, 0.02, 0.003], axis=0)
    return Motion("shaken", frames, supports=(Support(np.flatnonzero(body.pinned), maps),))


def placed(motion: Motion, frame: int) -> tuple[MovedPins, ...]:
    return tuple(MovedPins(support.vertices, support.maps[frame]) for support in motion.supports)
