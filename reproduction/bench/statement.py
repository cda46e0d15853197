"""Whether the statement of a report is true as often as it claims, over many small solids.

Each solid is a beam of its own size and stiffness whose linear space is made from two pulls. The statement is made from
59 fresh pulls as `ldsim simulate` makes it; then other pulls, drawn alike, say how many stay within it. The bound is an
order statistic, so the share of all pulls within it is Beta(k, n + 1 − k) distributed whatever the errors are, and how
many of the others stay within it is beta-binomial: from that comes how often at least 95 % of them should. Results go
to reproduction/results/statement.json.
"""

from __future__ import annotations

import math
from typing import cast

import numpy as np
from scipy.stats import betabinom, binom

from ldsim.arrays import Array
from ldsim.dynamics.full.stepper import FullStepper
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.dynamics.simulate import simulate
from ldsim.jit import one_thread
from ldsim.mechanics.motion import Motion
from ldsim.mechanics.options import PullOptions
from ldsim.mechanics.properties import Properties
from ldsim.mechanics.scene import Scene, make_scene
from ldsim.mesh.shapes import beam
from ldsim.pipeline.comparison import Reference, run_reduced, with_errors
from ldsim.pipeline.options import StatementOptions
from ldsim.pipeline.statement import bound, fresh_motions
from ldsim.space.options import PcaOptions
from ldsim.space.pca import Chunks, fit_basis
from ldsim.space.space import Space
from reproduction.harness import PIPELINE, Row, called, parser, row, show, write_results

NAME = "statement"
# Fresh pulls of a statement, others that judge it, and dimensions of the space.
STATED, OTHERS, DIMENSION = 59, 100, 5
# Results are written after so many solids.
WRITTEN = 20


def a_scene(rng: np.random.Generator) -> Scene:
    """A beam of some 20 to 60 tets, held at one end."""
    length, width = rng.uniform(0.2, 0.4), rng.uniform(0.06, 0.1)
    mesh = beam(length, width, 0.08, 1)
    modulus = 10 ** rng.uniform(4, 5)
    properties = Properties.uniform(mesh.n_cells, "stable_neo_hookean", modulus, 0.4, 1000.0)
    return make_scene(mesh, mesh.vertices[:, 0] < 1e-6, properties, (0.0, -9.8, 0.0), 0.01)


def errors_of(scene: Scene, seed: int) -> Array:
    """Online errors of all fresh pulls of a solid, in the order in which they were drawn."""
    size = scene.mesh.diagonal
    pulls = PullOptions(count=1, seed=seed, reach=0.3 * size, stiffness=5.0, radius=0.2 * size, frames=4, rest=2)
    learned, *motions = fresh_motions(scene, StatementOptions(motions=1 + STATED + OTHERS, pulls=pulls))
    full = FullStepper(scene)
    snapshots = _frames(full, learned)[0].reshape(learned.frames, -1)
    basis = fit_basis(cast(Chunks, lambda: iter([snapshots])), scene.mass, PcaOptions(k=DIMENSION)).basis
    space = Space.linear(scene, basis, DIMENSION)
    stepper = ReducedStepper(space)
    errors = np.full(len(motions), math.inf)
    for i, motion in enumerate(motions):
        u, held = _frames(full, motion)
        reference = Reference(motion, held, _Frames(u))
        played = run_reduced(stepper, reference)
        found = with_errors(played, space, reference).relative_error
        errors[i] = math.inf if found is None or math.isnan(found) else found
    return errors


class _Frames:
    """Frames start … stop − 1 of those that are given."""

    def __init__(self, u: Array) -> None:
        self._u = u

    def __call__(self, start: int, stop: int) -> Array:
        return self._u[start:stop]


def _frames(stepper: FullStepper, motion: Motion) -> tuple[Array, dict[int, np.ndarray]]:
    """A motion in the full space, (N, n, 3) metres, and what its drags hold."""
    frames = list(simulate(stepper, motion))
    return np.stack([frame.state.u for frame in frames]), dict(frames[-1].held)


def expected(quantile: float) -> float:
    """How often at least a quantile of the others should stay within the bound of those that were stated."""
    k = 1 + int((binom.cdf(np.arange(STATED), STATED, quantile) >= 0.95).argmax())
    return float(betabinom.sf(math.ceil(quantile * OTHERS) - 1, OTHERS, k, STATED + 1 - k))


def main() -> None:
    arguments = parser(NAME, __doc__)
    arguments.add_argument("--solids", type=int, default=200, help="how many are tried")
    given, held, shares = arguments.parse_args(), list[bool](), list[float]()
    for seed in range(given.solids):
        with one_thread():
            errors = errors_of(a_scene(np.random.default_rng((seed, 0))), seed)
        stated = bound(errors[:STATED], 0.95, 0.95)
        shares.append(float((errors[STATED:] <= stated.error).mean()))
        held.append(shares[-1] >= stated.quantile)
        if (seed + 1) % WRITTEN == 0 or seed + 1 == given.solids:
            write_results(NAME, called(NAME), _rows(np.array(held), np.array(shares)), inputs=PIPELINE)


def _rows(held: Array, shares: Array) -> list[Row]:
    chance, count = expected(0.95), len(held)
    low, high = (float(binom.ppf(share, count, chance)) / count for share in (0.025, 0.975))
    rows = [
        row("statements", "solids", count),
        row("statements", "held by the other pulls", float(held.mean()), goal=f">= {low:.3f}"),
        row("statements", "should hold, by theory", chance),
        row("statements", "95 % interval of that, low", low),
        row("statements", "95 % interval of that, high", high),
        row("statements", "pulls within the bound, mean", float(shares.mean())),
        row("statements", "pulls within the bound, by theory", STATED / (STATED + 1)),
    ]
    show(rows)
    return rows


if __name__ == "__main__":
    main()
