"""Where a pulled solid comes to rest once it is let go.

Pulls in several directions, each released and stepped in the latent space until nothing moves. Prints how far every one
of these ends is from the equilibrium of the full space, from the nearest pose that the latent space has of it, and from
the other ends.
"""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ldsim.dynamics.full.options import FullOptions
from ldsim.dynamics.full.stepper import FullStepper
from ldsim.jit import one_thread
from ldsim.mechanics.loads import Loads
from ldsim.run import Run
from ldsim.simulator import Simulator
from reproduction.harness import called, parser, row, show, write_results

Array = NDArray[np.float64]

NAME = "released"
PULLS = 6
HELD_STEPS = 60
# Steps after which a solid that still moves is taken as it is, and the speed that counts as rest, in diagonals a step.
LONGEST = 20_000
REST = 1e-9


def released(sim: Simulator, rng: np.random.Generator) -> tuple[Array, int]:
    """Pull at random, let go, step until at rest; the displacement, (n, 3) m, and the steps since the release."""
    sim.reset()
    vertices, diagonal = sim.scene.mesh.vertices[sim.scene.free], sim.scene.mesh.diagonal
    point = rng.choice(vertices)
    held = sim.grab(point, point + 0.3 * diagonal * rng.normal(size=3), at_rest=True)
    sim.step(HELD_STEPS)
    held.release()
    before, steps = sim.displacement(), 0
    while steps < LONGEST:
        sim.step(20)
        steps += 20
        now = sim.displacement()
        if np.abs(now - before).max() <= 20 * REST * diagonal:
            break
        before = now
    return now, steps


def measure(name: str, run: Run) -> None:
    """Measure and write one run."""
    space = run.space("latent")
    stepper = FullStepper(run.scene, FullOptions(quasistatic=True))
    state, solved = stepper.step(stepper.rest(), Loads())
    rng, sim = np.random.default_rng(0), Simulator(space, run.stepper(space, tolerance=1e-8))
    ends = [released(sim, rng) for _ in range(PULLS)]
    nearest = space.displacement(space.decoder(space.encode(state.u[None])[0][0]))

    def away(u: Array, v: Array) -> float:
        return 1e3 * float(np.linalg.norm(u - v, axis=1).mean())

    rows = [
        row(name, "mean displacement of the full space's equilibrium", away(state.u, 0 * state.u), "mm"),
        row(name, "gradient there", solved.gradient_norm, "N"),
        row(name, "nearest latent pose to the equilibrium", away(nearest, state.u), "mm"),
        row(name, "training error, mean", 1e3 * float(run.model.errors[0, 1]), "mm"),
        *(row(name, f"pull {i}: end to the equilibrium", away(u, state.u), "mm") for i, (u, _) in enumerate(ends)),
        row(name, "farthest apart two ends", max(away(u, v) for (u, _), (v, _) in combinations(ends, 2)), "mm"),
        row(name, "steps to rest, most", max(steps for _, steps in ends)),
    ]
    show(rows)
    write_results(f"released_{name}", called(NAME), rows)


def main() -> None:
    arguments = parser(NAME, __doc__)
    arguments.add_argument("run", type=Path, help="folder of a finished run")
    given = arguments.parse_args()
    with Run.open(given.run) as run, one_thread():
        measure(given.run.name, run)


if __name__ == "__main__":
    main()
