"""What one evaluation of the incremental potential is spent on, for Figure 12."""

from __future__ import annotations

import time

import numpy as np

from ldsim.arrays import Array
from ldsim.dynamics.reduced.minimiser import cholesky
from ldsim.dynamics.reduced.potential import Reduced, Springs, Work
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.dynamics.reduced.tangent import rest_metric
from ldsim.jit import njit, one_thread
from ldsim.run import Run
from ldsim.space.decoder import decode, decode_jacobian
from reproduction.bench.step_parts import CALLS, PARTS, STATES, TRIES

NAMES = {
    "… network, forwards": "decoder",
    "… network, backwards": "its transpose",
    "… strains of the points": "strains",
    "… their stresses": "stresses",
    "… their forces": "forces",
}


@njit(nogil=True)
def _preconditioner(n: int, model: Reduced, springs: Springs, work: Work, z: Array) -> None:
    """Eq. 15 and its factor."""
    for _ in range(n):
        decode(model.layers, z, work.hidden, work.q)
        if model.layers.sizes.shape[0] > 1:
            decode_jacobian(model.layers, work.hidden, work.tangents, work.jacobian)
        rest_metric(model, work)
        cholesky(work.hessian)


def parts_of_evaluation(run: Run, name: str) -> dict[str, float]:
    """Microseconds of each part of an evaluation and of the preconditioner, at states of the first training motion;
    the least of several tries."""
    space, played = run.space(name), run.simulation[name][run.snapshots.with_role("train")[0]]
    coordinates = played.latent if played.latent is not None else played.coordinates
    assert coordinates is not None
    z = np.ascontiguousarray(coordinates[np.linspace(5, len(coordinates) - 1, STATES).astype(int)], dtype=np.float64)
    timed = {NAMES[part]: PARTS[part][0] for part in NAMES} | {"preconditioner": _preconditioner}
    arguments = ReducedStepper(space).compiled()
    best = dict.fromkeys(timed, np.inf)
    with one_thread():
        for attempt in range(TRIES):
            for part, loop in timed.items():
                _preconditioner(1, *arguments, z[attempt % STATES])  # so that every part finds a state of this z
                loop(1, *arguments, z[attempt % STATES])
                started = time.perf_counter()
                loop(CALLS, *arguments, z[attempt % STATES])
                best[part] = min(best[part], 1e6 * (time.perf_counter() - started) / CALLS)
    return best
