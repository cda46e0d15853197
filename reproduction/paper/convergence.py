"""Figure 9: how fast each space relaxes a bent solid to rest, quasi-statically."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ldsim.arrays import Array
from ldsim.dynamics.full.options import FullOptions
from ldsim.dynamics.full.stepper import FullState, FullStepper
from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.state import ReducedState
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.jit import one_thread
from ldsim.mechanics.elastic import elastic_energy
from ldsim.mechanics.loads import Loads
from ldsim.mechanics.scene import Scene
from ldsim.optimise.solution import Solution
from ldsim.report.svg import PALETTE, legend, log_scale, new_axes, to_svg
from ldsim.run import Run
from ldsim.space.encoder import nearest_latent
from ldsim.space.space import Space
from reproduction.harness import Harness
from reproduction.paper.experiment import Outcome, Relation
from reproduction.paper.scenes import cross
from reproduction.reduced_runs import latent, training_coordinates

Solve = Callable[[int], Solution]

# So long a time step that inertia is nothing: a quasi-static solve.
FOREVER = 1e8
TOLERANCE = 1e-8
MOST = 2000
SHOWN = (1, 2, 3, 5, 8, 12, 18, 25, 35, 50, 70, 100, 140, 200, 300)
# The same stop for all: gradients of different coordinates cannot be compared, potentials can. Of that of the pose.
STOP = 1e-6
TRIES = 3


class Stopped(NamedTuple):
    """What it took to bring the potential down to the stop; NaN where it did not come there."""

    iterations: float
    evaluations: float
    seconds: float


def _full(scene: Scene, u: Array) -> Solve:
    @lru_cache(maxsize=1)  # what is timed is the second solve, with a stepper that is there
    def stepper(most: int) -> FullStepper:
        # the rest pose's Hessian throughout, as in the paper
        return FullStepper(scene, FullOptions(tolerance=TOLERANCE, factor_cost=10**9, max_iterations=most))

    return lambda most: stepper(most).step(FullState(u, u, np.zeros_like(u)), Loads())[1]


def _reduced(space: Space, z: Array) -> Solve:
    q = space.decoder(z)

    @lru_cache(maxsize=1)
    def stepper(most: int) -> ReducedStepper:
        options = ReducedOptions(tolerance=TOLERANCE, max_iterations=most, method="lbfgs", current=False, inertia=False)
        return ReducedStepper(space, options)

    return lambda most: stepper(most).step(ReducedState.moving(z, z, q, q), Loads())[1]


def _solves(run: Run) -> tuple[dict[str, Solve], float]:
    """A solve in each space from the pose of the training motion that is farthest from rest, and its potential, J."""
    scene = replace(run.scene, gravity=np.zeros(3), time_step=FOREVER)
    q, model = training_coordinates(run), run.model
    farthest = int(np.linalg.norm(q, axis=1).argmax())
    z = nearest_latent(model.decoder, q[farthest], model.encoder(q[farthest : farthest + 1])[0])
    u = run.basis.displacement(q[farthest])
    solves = {
        "latent": _reduced(replace(latent(run), scene=scene), z),
        "linear": _reduced(Space.linear(scene, run.basis, model.kp), q[farthest, : model.kp]),
        "full": _full(scene, u),
    }
    return solves, elastic_energy(scene.elements, u)


def stopped(solve: Solve, limit: float, most: int) -> Stopped:
    """The first iteration after which the potential is at most the limit, J, and the time until then.

    Args:
        most: iterations after which it surely is, if ever.
    """
    if not solve(most).value <= limit:
        return Stopped(np.nan, np.nan, np.nan)
    low, high = 0, most  # a solve cut short repeats the beginning of a longer one, so its end can be searched for
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if solve(middle).value <= limit else (middle, high)
    seconds = []
    for _ in range(TRIES):
        started = time.perf_counter()
        solution = solve(high)
        seconds.append(time.perf_counter() - started)
    return Stopped(solution.iterations, solution.evaluations, min(seconds))


def convergence(bench: Harness) -> Outcome:
    """Iterations, evaluations and seconds of each space to the same stop, and the potential on the way."""
    with Run.open(bench.made(cross(bench.quick), "train")) as run, one_thread():
        solves, start = _solves(run)
        dimensions = {"latent": run.model.decoder.r, "linear": run.model.kp, "full": 3 * len(run.scene.free)}
        ends = {space: solve(MOST) for space, solve in solves.items()}
        curves = {
            space: [(most, solve(most).value) for most in SHOWN if most < ends[space].iterations]
            + [(ends[space].iterations, ends[space].value)]
            for space, solve in solves.items()
        }
        stops = {space: stopped(solve, STOP * start, ends[space].iterations) for space, solve in solves.items()}
    figure, ax = new_axes("iterations", "potential, J", height=3.2)
    for space, curve in curves.items():
        iterations, values = np.array(curve).T
        shown = values > 0
        ax.plot(iterations[shown], values[shown], color=PALETTE[space], marker=".", label=space)
    log_scale(ax, "y")
    legend(ax)
    found = {
        space: {
            "dimension": dimensions[space],
            "to_the_same_stop": stops[space]._asdict(),
            "iterations": end.iterations,
            "evaluations": end.evaluations,
            "potential_j": end.value,
            "gradient_norm_n": end.gradient_norm,
            "reason": end.reason.words,
        }
        for space, end in ends.items()
    }
    label = "Potential against iterations of L-BFGS in the latent, the linear and the full space, relaxing to rest"
    numbers = {"stop_j": STOP * start, "spaces": found, "curves": curves}
    return Outcome(to_svg(figure, label), numbers, convergence_relations(stops, ends["latent"].value))


def convergence_relations(stops: Mapping[str, Stopped], floor: float) -> tuple[Relation, ...]:
    """The relations of Figure 9.

    Args:
        stops: of each space, what the same stop took.
        floor: the potential that the latent space ends with, J.
    """
    latent, linear, full = (stops[space] for space in ("latent", "linear", "full"))
    return (
        Relation("iterations, latent over linear", latent.iterations / linear.iterations, "< 1", paper=46 / 90),
        Relation("iterations, linear over full", linear.iterations / full.iterations, "< 1", paper=90 / 216),
        Relation("time, latent over linear", latent.seconds / linear.seconds, "< 1", paper=563 / 961),
        Relation("potential that the latent space ends with, J", abs(floor), "<= 1e-12", paper=4.3e-8),
    )
