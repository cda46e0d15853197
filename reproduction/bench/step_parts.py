"""Where the time of a reduced step goes.

The parts of one evaluation, each compiled in a loop of its own at states of the first motion; what is beside them in a
step; and the same number of multiplications and additions at the rate of a large matrix product. Whole steps with the
stop rule as the paper prints it, and as its authors' code applies it (10⁻⁸ of h² times the potential). One thread.
Every number is the least of several tries spread over the run, for other tenants of a machine only ever add time.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.potential import Reduced, Springs, Work, add_forces, strains, value_gradient
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.dynamics.reduced.tangent import current_tangent
from ldsim.dynamics.trajectory import Trajectory
from ldsim.jit import njit, one_thread
from ldsim.mechanics.materials.kernels import weighted_stresses
from ldsim.pipeline.comparison import run_reduced
from ldsim.run import Run
from ldsim.space.decoder import decode, decode_jacobian, decode_vjp
from reproduction.harness import Row, called, parser, row, show, write_results
from reproduction.reduced_runs import reference

Array = NDArray[np.float64]

NAME = "step_parts"
CALLS = 2000
TRIES = 12
STATES = 8
STEPS = 10_000
STOPS = (1e-8, 4e-4)


@njit(nogil=True)
def _evaluation(n: int, model: Reduced, springs: Springs, work: Work, z: Array) -> None:
    for _ in range(n):
        value_gradient(model, springs, work.q, z, work, work.g_new)


@njit(nogil=True)
def _decode(n: int, model: Reduced, springs: Springs, work: Work, z: Array) -> None:
    for _ in range(n):
        decode(model.layers, z, work.hidden, work.q)


@njit(nogil=True)
def _strains(n: int, model: Reduced, springs: Springs, work: Work, z: Array) -> None:
    for _ in range(n):
        strains(model.G, work.q, model.lifted, work.strain)


@njit(nogil=True)
def _stresses(n: int, model: Reduced, springs: Springs, work: Work, z: Array) -> None:
    strains(model.G, work.q, model.lifted, work.strain)
    kept = work.strain.copy()
    for _ in range(n):
        work.strain[:] = kept
        weighted_stresses(model.kind, work.strain, model.weights, model.mu, model.lam)


@njit(nogil=True)
def _forces(n: int, model: Reduced, springs: Springs, work: Work, z: Array) -> None:
    work.strain[:] = 1e-3
    for _ in range(n):
        add_forces(model.G, work.strain, work.force)


@njit(nogil=True)
def _vjp(n: int, model: Reduced, springs: Springs, work: Work, z: Array) -> None:
    work.force[:] = 1.0
    for _ in range(n):
        decode_vjp(model.layers, work.hidden, work.force, work.scratch, work.g_new)


@njit(nogil=True)
def _renewal(n: int, model: Reduced, springs: Springs, work: Work, z: Array) -> None:
    for _ in range(n):
        decode_jacobian(model.layers, work.hidden, work.tangents, work.jacobian)
        current_tangent(model, work)


Part = Callable[[int, Reduced, Springs, Work, Array], None]
PARTS: dict[str, tuple[Part, int]] = {
    "one evaluation": (_evaluation, CALLS),
    "… network, forwards": (_decode, CALLS),
    "… strains of the points": (_strains, CALLS),
    "… their stresses": (_stresses, CALLS),
    "… their forces": (_forces, CALLS),
    "… network, backwards": (_vjp, CALLS),
    "renewal of the preconditioner": (_renewal, CALLS // 20),
}


def measure(model: str, run: Run) -> list[Row]:
    """The rows of one finished run, its latent space."""
    space, first = run.space("latent"), reference(run, run.snapshots.names[0])
    decoder, points = space.decoder, len(space.rule.points)
    latent = run.simulation["latent"][first.motion.name].latent
    assert latent is not None
    z = np.ascontiguousarray(latent[np.linspace(5, len(latent) - 1, STATES).astype(int)], dtype=np.float64)
    steppers = {stop: ReducedStepper(space, ReducedOptions(tolerance=stop)) for stop in STOPS}
    for stepper in steppers.values():
        run_reduced(stepper, first)
    best = dict.fromkeys(PARTS, np.inf)
    runs: dict[float, list[Trajectory]] = {stop: [] for stop in STOPS}
    for attempt in range(TRIES):
        arguments = steppers[STOPS[0]].compiled()
        for name, (part, calls) in PARTS.items():
            _decode(1, *arguments, z[attempt % STATES])
            part(1, *arguments, z[attempt % STATES])
            started = time.perf_counter()
            part(calls, *arguments, z[attempt % STATES])
            best[name] = min(best[name], 1e6 * (time.perf_counter() - started) / calls)
        for stop, stepper in steppers.items():
            runs[stop].append(run_reduced(stepper, first))
    sizes = decoder.layers.sizes
    products = 2 * int(np.sum(sizes[1:] * sizes[:-1])) + 2 * 9 * decoder.k * points
    label = f"r {decoder.r}, k {decoder.k}, {points} points"
    rows = [row(model, f"{name}, {label}", value, "µs") for name, value in best.items()]
    rows += [
        row(model, "multiplications and additions of one evaluation", products),
        row(model, "… at the rate of a large matrix product", 1e6 * products / rate(), "µs"),
    ]
    for stop, done in runs.items():
        rows += steps(model, f"{first.motion.name}, stop {stop:g} N", done, best["one evaluation"])
    return rows


def steps(model: str, label: str, runs: list[Trajectory], evaluation_us: float) -> list[Row]:
    """What whole steps took in several runs of one motion."""
    microseconds = [1e6 * run.seconds for run in runs]
    least, every = np.nanmin(microseconds, axis=0), np.concatenate(microseconds)[-STEPS:]
    evaluations = float(runs[0].evaluations.mean())
    return [
        row(model, f"evaluations a step, {label}", evaluations, "", "<= 8"),
        row(model, f"median step, {label}", float(np.nanmedian(least)), "µs", "<= 100"),
        row(model, f"… of it evaluations, {label}", evaluations * evaluation_us, "µs"),
        row(model, f"99th percentile over median, the last {len(every):,} steps, {label}", tail(every), "", "<= 3"),
        row(model, f"… of the least time of each step, {label}", tail(least)),
    ]


def tail(seconds: Array) -> float:
    return float(np.nanpercentile(seconds, 99) / np.nanmedian(seconds))


def rate() -> float:
    """Multiplications and additions a second of a matrix product in double precision, one thread."""
    A = np.random.default_rng(0).normal(size=(600, 600))
    seconds = []
    for _ in range(TRIES):
        started = time.perf_counter()
        A @ A
        seconds.append(time.perf_counter() - started)
    return float(600**3 / min(seconds))


def main() -> None:
    arguments = parser(NAME, __doc__)
    arguments.add_argument("run", type=Path, help="folder of a finished run")
    folder = arguments.parse_args().run
    with Run.open(folder) as run, one_thread():
        found = measure(folder.name, run)
    show(found)
    write_results(f"step_parts_{folder.name}", called(NAME), found)


if __name__ == "__main__":
    main()
