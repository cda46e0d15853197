"""Where a pulled solid comes to rest once it is let go: python benchmarks/released.py runs/x

Pulls in several directions, each released and stepped in the latent space until nothing moves. Prints how far every one
of these ends is from the equilibrium of the full space, from the nearest pose that the latent space has of it, and from
the other ends.
"""

from __future__ import annotations

import sys
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from results_file import row, write_results

from ldsim import load
from ldsim.artefacts.records import read_basis, read_model
from ldsim.dynamics.full.options import FullOptions
from ldsim.dynamics.full.stepper import FullState, FullStepper
from ldsim.jit import one_thread
from ldsim.simulator import Simulator
from ldsim.space.encoder import nearest_latent

Array = NDArray[np.float64]

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


def main(folder: Path) -> None:
    sim = load(folder, tolerance=1e-8)
    scene = sim.scene
    with one_thread():
        full, solved = FullStepper(scene, FullOptions(quasistatic=True)).step(
            FullState.at_rest(scene.mesh.n_vertices), []
        )
        rng = np.random.default_rng(0)
        ends = [released(sim, rng) for _ in range(PULLS)]
    model, U = read_model(folder / "model.h5")[0], read_basis(folder / "basis.h5")[0].basis.U
    q = U.T @ (scene.mass @ full.u).ravel()
    nearest = U @ model.decoder(nearest_latent(model.decoder, q, model.encoder(q[None])[0]))

    def away(u: Array, v: Array) -> float:
        return 1e3 * float(np.linalg.norm(u.reshape(-1, 3) - v.reshape(-1, 3), axis=1).mean())

    rows = [
        row(folder.name, "mean displacement of the full space's equilibrium", away(full.u, 0 * full.u), "mm"),
        row(folder.name, "gradient there", solved.gradient_norm, "N"),
        row(folder.name, "nearest latent pose to the equilibrium", away(nearest, full.u), "mm"),
        row(folder.name, "training error, mean", 1e3 * model.errors[0, 1], "mm"),
        *(
            row(folder.name, f"pull {i}: end to the equilibrium", away(u, full.u), "mm")
            for i, (u, _) in enumerate(ends)
        ),
        row(folder.name, "farthest apart two ends", max(away(u, v) for (u, _), (v, _) in combinations(ends, 2)), "mm"),
        row(folder.name, "steps to rest, most", max(steps for _, steps in ends)),
    ]
    for r in rows:
        print(f"| {r['quantity']} | {r['value']:.4g} | {r['unit']} |")
    write_results(f"released_{folder.name}", f"python benchmarks/released.py runs/{folder.name}", rows)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python benchmarks/released.py runs/EXPERIMENT (a finished run)")
    main(Path(sys.argv[1]))
