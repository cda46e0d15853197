"""Steps of a batch on a processor in double precision: the compiled step, one instance after another on each thread.

Newton's method on tensors, which a graphics card is good at, takes a processor several times as long: its temporaries
leave the caches, and it makes every Hessian anew. Here each instance goes on from the inverse Hessian of its last step.
"""

from __future__ import annotations

import os
import threading
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ldsim.arrays import Array
from ldsim.dynamics.batched.newton import BatchedSolution
from ldsim.dynamics.batched.potential import BatchedLoads, BatchedModel
from ldsim.dynamics.reduced.advance import StepReference, advance
from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.potential import Reduced
from ldsim.dynamics.reduced.state import numbers_of_a_state, state_rows
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.jit import njit
from ldsim.space.space import Space

# Iterations, evaluations, reason, E and ‖∇E‖ of one step.
RECORD = 5


class Acting(NamedTuple):
    """`BatchedLoads` in numbers, as the compiled steps read it.

    B (n, g, 3, k), centre and target (n, g, 3), stiffness (n, g): the grabs. mu, lam (n,): factors of the moduli. force
    (n, k): on q, N. lifted (n, c, 9): what pins add at every point, or (n, 0, 9) where none can move. follows (n, m):
    a of modes that swing.
    """

    B: Array
    centre: Array
    target: Array
    stiffness: Array
    mu: Array
    lam: Array
    force: Array
    lifted: Array
    follows: Array

    @classmethod
    def of(cls, model: BatchedModel, loads: BatchedLoads) -> Acting:
        given = loads.B, loads.centre, loads.target, loads.stiffness, loads.mu, loads.lam, model.dead(loads)
        lifted = loads.a.new_zeros(len(loads.a), 0, 9)
        if model.lifted.shape[1]:
            lifted = (loads.a @ model.lifted).permute(1, 2, 0)
        return cls(*(np.ascontiguousarray(each.numpy()) for each in (*given, lifted, loads.follows)))


@njit(cache=True, nogil=True)
def advance_many(
    reference: StepReference,
    moduli: tuple[Array, Array, Array, Array],
    acting: Acting,
    before: Array,
    lacking: NDArray[np.bool_],
    others: bool,
    after: Array,
    records: Array,
) -> None:
    """`advance` of many instances, one after another, without a word of Python between them.

    Args:
        reference: of a model and springs of its own (`ReducedStepper.unloaded`), which what acts is written into.
        moduli: μ and λ of its points, (c,) each, ω² of its modes, and its inertia with all of that of the modes.
        before, after: `ReducedState.data` of each, after is overwritten. lacking: which have no preconditioner.
        others: False, for inverse Hessians hold no springs; as a constant it would have the whole step compiled again.
        records: (n, RECORD), what `advance` returns of each, overwritten.
    """
    model, springs = reference.content[0], reference.content[1]
    for i in range(before.shape[0]):
        springs.B[:], springs.centre[:], springs.target[:] = acting.B[i], acting.centre[i], acting.target[i]
        springs.stiffness[:], model.force[:] = acting.stiffness[i], acting.force[i]
        model.lifted[:] = acting.lifted[i]
        for s in range(model.mu.shape[0]):
            model.mu[s], model.lam[s] = acting.mu[i] * moduli[0][s], acting.lam[i] * moduli[1][s]
        _follow(model, moduli[2], moduli[3], acting.mu[i], acting.follows[i])
        records[i, 0], records[i, 1], records[i, 2], records[i, 3], records[i, 4] = advance(
            reference, before[i], lacking[i], others, after[i]
        )


@njit(cache=True, nogil=True)
def _follow(model: Reduced, squares: Array, inertia: Array, scale: float, follows: Array) -> None:
    """The modes of an instance so many times as stiff."""
    first = inertia.shape[1] - follows.shape[0]
    for j in range(follows.shape[0]):
        model.follows[j], model.gives[j] = follows[j], follows[j] / (scale * squares[j])
        for row in range(inertia.shape[0]):
            model.inertia[row, first + j] = follows[j] * inertia[row, first + j]


class _Kept(threading.local):
    """What each thread steps by, by the number of grabs: a step of few instances takes less time than making it."""

    def __init__(self) -> None:
        self.known: dict[int, tuple[StepReference, tuple[Array, Array, Array, Array]]] = {}


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    """Kept, for new threads run on one core for some milliseconds."""
    return ThreadPoolExecutor(threads)


if hasattr(os, "register_at_fork"):  # a process that forks from this one has the pool, but not its threads
    os.register_at_fork(after_in_child=_pool.cache_clear)


class CompiledSteps:
    """The minimisers of one step of many instances, by as many threads as torch may use.

    Args:
        model: of the same space on tensors, for what acts.
    """

    def __init__(self, space: Space, model: BatchedModel, options: ReducedOptions) -> None:
        self._stepper, self._model = ReducedStepper(space, options), model
        self._kept = _Kept()

    def __call__(
        self, z: Tensor, z_previous: Tensor, kept: Tensor, predictor: Tensor, loads: BatchedLoads
    ) -> tuple[Tensor, Tensor, Tensor, BatchedSolution]:
        """The minimisers, (n, r), with z where an instance has no finite energy to start from; φ of them, (n, k); what
        the next step takes over (`BatchedState.kept`); and the record."""
        (n, r), k = z.shape, predictor.shape[1]
        acting = Acting.of(self._model, loads)
        before, lacking = state_rows(z.numpy(), z_previous.numpy(), predictor.numpy(), kept.numpy())
        after = np.empty((n, numbers_of_a_state(r, k, acting.stiffness.shape[1])))
        records = np.empty((n, RECORD))

        def some(part: slice) -> None:
            """Those of one thread, which writes nothing of others but rows of its own."""
            reference, moduli = self._of_thread(acting.stiffness.shape[1])
            own = Acting._make(each[part] for each in acting)
            advance_many(reference, moduli, own, before[part], lacking[part], False, after[part], records[part])

        threads = torch.get_num_threads()
        count = max(min(threads, n), 1)
        parts = [slice(n * i // count, n * (i + 1) // count) for i in range(count)]
        list(map(some, parts) if len(parts) == 1 else _pool(threads).map(some, parts))
        columns = torch.from_numpy(records).unbind(1)
        iterations, evaluations, reason = (column.long() for column in columns[:3])
        solution = BatchedSolution(columns[3].clone(), columns[4].clone(), iterations, evaluations, reason)
        found, q = (torch.from_numpy(after[:, own].copy()) for own in (slice(r), slice(3 * r, 3 * r + k)))
        return found, q, torch.from_numpy(after), solution

    def _of_thread(self, grabs: int) -> tuple[StepReference, tuple[Array, Array, Array, Array]]:
        """What this thread steps by, and the moduli of the points."""
        known = self._kept.known
        if grabs not in known:
            model, _, reference = self._stepper.unloaded(grabs)
            inertia = self._stepper.inertia
            known[grabs] = reference, (model.mu.copy(), model.lam.copy(), model.squares.copy(), inertia)
        return known[grabs]
