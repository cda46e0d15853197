"""Steps of a batch on a processor in double precision: the compiled step, one instance after another on each thread.

Newton's method on tensors, which a graphics card is good at, takes a processor several times as long: its temporaries
leave the caches, and it makes every Hessian anew. Here each instance goes on from the inverse Hessian of its last step.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ldsim.arrays import Array
from ldsim.dynamics.batched.newton import BatchedSolution
from ldsim.dynamics.batched.potential import BatchedLoads, BatchedModel
from ldsim.dynamics.reduced.advance import advance
from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.potential import Reduced, Springs
from ldsim.dynamics.reduced.state import numbers_of_a_state, state_rows
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.space.space import Space

# Iterations, evaluations, reason, E and ‖∇E‖ of one step.
RECORD = 5


class CompiledSteps:
    """The minimisers of one step of many instances, by as many threads as torch may use.

    Args:
        model: of the same space on tensors, for what acts.
    """

    def __init__(self, space: Space, model: BatchedModel, options: ReducedOptions) -> None:
        self._stepper, self._model = ReducedStepper(space, options), model

    def __call__(
        self, z: Tensor, z_previous: Tensor, kept: Tensor, predictor: Tensor, loads: BatchedLoads
    ) -> tuple[Tensor, Tensor, BatchedSolution]:
        """The minimisers, (n, r), with z where an instance has no finite energy to start from; what the next step takes
        over (`BatchedState.kept`); and the record."""
        n, r = z.shape
        acting = _Acting.of(self._model, loads)
        before, fresh = state_rows(z.numpy(), z_previous.numpy(), predictor.numpy(), kept.numpy())
        after = np.empty((n, numbers_of_a_state(r, predictor.shape[1], acting.stiffness.shape[1])))
        records = np.empty((n, RECORD))

        def some(instances: range) -> None:
            """Those of one thread, which writes nothing of others but rows of its own."""
            model, springs, reference = self._stepper.unloaded(acting.stiffness.shape[1])
            mu, lam = model.mu.copy(), model.lam.copy()
            for i in instances:
                acting.load(i, model, springs)
                np.multiply(mu, acting.mu[i], out=model.mu)
                np.multiply(lam, acting.lam[i], out=model.lam)
                records[i] = advance(reference, before[i], fresh[i], False, after[i])

        _shared_out(some, n)
        columns = torch.from_numpy(records).unbind(1)
        iterations, evaluations, reason = (column.long() for column in columns[:3])
        solution = BatchedSolution(columns[3].clone(), columns[4].clone(), iterations, evaluations, reason)
        return torch.from_numpy(after[:, :r].copy()), torch.from_numpy(after), solution


def _shared_out(work: Callable[[range], None], n: int) -> None:
    """n instances on as many threads as torch may use."""
    threads = max(min(torch.get_num_threads(), n), 1)
    bounds = np.linspace(0, n, threads + 1).astype(int).tolist()
    parts = [range(first, last) for first, last in pairwise(bounds)]
    if threads == 1:
        work(parts[0])
        return
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(work, parts))


class _Acting(NamedTuple):
    """`BatchedLoads` in numbers, with the force on q, (n, k), and what pins add at every point, (n, c, 9)."""

    B: Array
    centre: Array
    target: Array
    stiffness: Array
    mu: Array
    lam: Array
    force: Array
    lifted: Array | None

    @classmethod
    def of(cls, model: BatchedModel, loads: BatchedLoads) -> _Acting:
        B, centre, target, stiffness, mu, lam = (
            each.numpy() for each in (loads.B, loads.centre, loads.target, loads.stiffness, loads.mu, loads.lam)
        )
        lifted = (loads.a @ model.lifted).permute(1, 2, 0).numpy() if model.lifted.shape[1] else None
        return cls(B, centre, target, stiffness, mu, lam, model.dead(loads).numpy(), lifted)

    def load(self, i: int, model: Reduced, springs: Springs) -> None:
        """Write what acts on one instance, but for its moduli, where a step reads it."""
        springs.B[:], springs.centre[:], springs.target[:] = self.B[i], self.centre[i], self.target[i]
        springs.stiffness[:], model.force[:] = self.stiffness[i], self.force[i]
        if self.lifted is not None:
            model.lifted[:] = self.lifted[i]
