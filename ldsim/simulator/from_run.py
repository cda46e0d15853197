"""A simulator made from a run, or from a scene alone."""

from __future__ import annotations

import math
from pathlib import Path

from ldsim.dynamics.full.options import FullOptions
from ldsim.dynamics.full.stepper import FullStepper
from ldsim.mechanics.scene import Scene
from ldsim.run import Run
from ldsim.simulator.simulator import Simulator
from ldsim.space.space import Space


def load(
    run: str | Path,
    space: str = "auto",
    *,
    points: int | None = None,
    tolerance: float | None = None,
    seconds: float = math.inf,
) -> Simulator:
    """A simulator of a finished run.

    Args:
        run: the folder of the run, such as runs/x.
        space: "latent", "linear", "linear_20" or "full", which needs only scene.h5; "auto" for the one that simulate
            chose for this solid, latent where it has not run.
        points: use the largest cubature of at most so many points of the mesh instead of the one that was chosen.
        tolerance: stop at ‖∇E‖ ≤ tolerance · max(‖x‖, 1), N; left out, the usual one of a reduced space
            (`ReducedOptions`) or the full one (`FullOptions`).
        seconds: after which a step of the full space begins no further iteration, however large its residual is then.

    Raises:
        ArtefactError: an artefact is missing, damaged, or was made from other files than those beside it.
    """
    with Run.open(run) as opened:
        found = opened.space(space, points)
        return Simulator(found, opened.stepper(found, tolerance, seconds))


def full_simulator(scene: Scene, tolerance: float | None = None, seconds: float = math.inf) -> Simulator:
    """A simulator of a scene in the full space, every vertex free; see `load`."""
    return Simulator(Space.full(scene), FullStepper(scene, FullOptions(tolerance=tolerance), seconds=seconds))
