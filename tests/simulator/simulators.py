"""Simulators of a small solid in every kind of space."""

from __future__ import annotations

import numpy as np
import pytest

from ldsim.arrays import Array
from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.mechanics.scene import Scene
from ldsim.simulator import Simulator, full_simulator
from ldsim.space.decoder import Decoder
from ldsim.space.lifting import Lifting
from tests.helpers import reduced_space
from tests.simulator.playable import curved_decoder, modes, solid

BODY = solid(1)
TIP = BODY.mesh.vertices[BODY.mesh.vertices[:, 0].argmax()]
UP = np.array([0.0, 0.05, 0.02])


def reduced(
    body: Scene = BODY,
    decoder: Decoder | None = None,
    U: Array | None = None,
    lifting: Lifting | None = None,
    **options: float,
) -> Simulator:
    decoder = curved_decoder() if decoder is None else decoder
    space = reduced_space(body, modes(body) if U is None else U, decoder, lifting=lifting)
    return Simulator(space, ReducedStepper(space, ReducedOptions(tolerance=1e-9, max_iterations=500)), **options)


def every_kind(body: Scene = BODY) -> list[Simulator]:
    return [reduced(body), reduced(body, Decoder.identity(9)), full_simulator(body, 1e-9)]


kinds = pytest.mark.parametrize("kind", range(3), ids=["latent", "linear", "full"])
