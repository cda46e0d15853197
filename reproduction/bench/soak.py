"""Random grabs far outside the training data for 100,000 steps.

Grabs come and go with targets up to a hundred diagonals away, up to as stiff as steel; gravity grows to a hundred
times the earth's, the material changes tenfold either way. Prints what came of the steps and how memory grew, and
fails where a state is not finite or further from rest than the simulator allows. `--quick` takes 5,000 steps.
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
from tqdm import trange

from ldsim.jit import one_thread
from ldsim.run import SPACES, peak_memory_mb
from ldsim.simulator import Handle, Simulator, load
from ldsim.simulator.simulator import BOUND
from reproduction.harness import called, parser, row, show, write_results

NAME = "soak"
STEPS, QUICK = 100_000, 5_000


def soak(simulator: Simulator, rng: np.random.Generator, steps: int) -> float:
    """Mistreat a simulator for so many steps; returns the farthest that it got from rest, in diagonals.

    Raises:
        AssertionError: a state is not finite, or out of bounds.
    """
    scene, farthest = simulator.scene, 0.0
    movable, diagonal = scene.mesh.vertices[scene.free], scene.mesh.diagonal
    handles: list[Handle] = []
    for _ in trange(0, steps, 10, unit_scale=10, unit="step", mininterval=5):
        if handles and rng.random() < 0.5:
            handles.pop(int(rng.integers(len(handles)))).release()
        if len(handles) < 3 and rng.random() < 0.6:
            point, far = rng.choice(movable), diagonal * 10 ** rng.uniform(-1, 2)
            stiffness = 10 ** rng.uniform(0, 6)
            handles.append(simulator.grab(point, point + far * rng.normal(size=3), stiffness, at_rest=True))
        simulator.gravity = rng.normal(size=3) * 10 ** rng.uniform(0, 3)
        simulator.material_scale = 10 ** rng.uniform(-1, 1)
        simulator.step(10)
        u = simulator.displacement()
        assert np.isfinite(u).all(), simulator.last
        distance = float(np.sqrt(np.vdot(u, scene.mass @ u) / scene.mass.sum())) / diagonal
        assert distance <= BOUND * (1 + 1e-9), simulator.last
        farthest = max(farthest, distance)
    return farthest


def main() -> None:
    arguments = parser(NAME, __doc__)
    arguments.add_argument("run", type=Path, help="folder of a finished run")
    arguments.add_argument("--space", choices=SPACES, default="latent")
    arguments.add_argument("--quick", action="store_true", help="5,000 steps")
    given = arguments.parse_args()
    steps = QUICK if given.quick else STEPS
    with one_thread():
        simulator = load(given.run, given.space)
        soak(simulator, np.random.default_rng(0), 100)
        simulator.reset()
        before, started = peak_memory_mb(), time.perf_counter()
        farthest = soak(simulator, np.random.default_rng(1), steps)
        seconds = time.perf_counter() - started
    found: list[tuple[str, float, str]] = [
        *((f"steps {outcome.name.lower()}", count, "") for outcome, count in simulator.counts.items()),
        ("farthest from rest", round(farthest, 3), "diagonals"),
        ("time", round(seconds, 1), "s"),
        ("memory grown", round(peak_memory_mb() - before, 1), "MB"),
    ]
    rows = [row(given.run.name, f"{given.space}, {name}", value, unit) for name, value, unit in found]
    show(rows)
    if not given.quick:
        write_results("soak", called(NAME), rows)


if __name__ == "__main__":
    main()
