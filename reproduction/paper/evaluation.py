"""What one evaluation of the incremental potential is spent on, for Figure 12."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from ldsim.arrays import Array
from ldsim.dynamics.reduced.minimiser import cholesky
from ldsim.dynamics.reduced.potential import Reduced, Springs, Work, add_forces, strains
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.dynamics.reduced.tangent import rest_metric
from ldsim.jit import njit, one_thread
from ldsim.mechanics.materials.kernels import weighted_stresses
from ldsim.run import Run
from ldsim.space.decoder import decode, decode_jacobian, decode_vjp

CALLS, TRIES, STATES = 2000, 12, 8
Part = Callable[[int, Reduced, Springs, Work, Array], None]


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
def _preconditioner(n: int, model: Reduced, springs: Springs, work: Work, z: Array) -> None:
    """Eq. 15 and its factor."""
    for _ in range(n):
        decode(model.layers, z, work.hidden, work.q)
        if model.layers.sizes.shape[0] > 1:
            decode_jacobian(model.layers, work.hidden, work.tangents, work.jacobian)
        rest_metric(model, work)
        cholesky(work.hessian)


PARTS: dict[str, Part] = {
    "decoder": _decode,
    "its transpose": _vjp,
    "strains": _strains,
    "stresses": _stresses,
    "forces": _forces,
    "preconditioner": _preconditioner,
}


def parts_of_evaluation(run: Run, name: str) -> dict[str, float]:
    """Microseconds of each part of an evaluation and of the preconditioner, at states of the first training motion;
    the least of several tries."""
    space, played = run.space(name), run.simulation[name][run.snapshots.with_role("train")[0]]
    coordinates = played.latent if played.latent is not None else played.coordinates
    assert coordinates is not None
    z = np.ascontiguousarray(coordinates[np.linspace(5, len(coordinates) - 1, STATES).astype(int)], dtype=np.float64)
    arguments = ReducedStepper(space).compiled()
    best = dict.fromkeys(PARTS, np.inf)
    with one_thread():
        for attempt in range(TRIES):
            for part, loop in PARTS.items():
                _preconditioner(1, *arguments, z[attempt % STATES])  # so that every part finds a state of this z
                loop(1, *arguments, z[attempt % STATES])
                started = time.perf_counter()
                loop(CALLS, *arguments, z[attempt % STATES])
                best[part] = min(best[part], 1e6 * (time.perf_counter() - started) / CALLS)
    return best
