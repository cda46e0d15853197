"""Newton's method for many instances at once: each has its own step length, its own end and its own reason for it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from ldsim.dynamics.batched.potential import BatchedLoads, BatchedModel
from ldsim.optimise.line_search import (
    AFTER_INFINITE,
    ARMIJO,
    FALLEN,
    HALF,
    LONGEST,
    MAX_BACKTRACKS,
    RISEN,
    ROUNDOFF,
    SHORTEST,
)
from ldsim.optimise.solution import Reason

RUNNING = -1
# Values closer than this share are told apart by their slopes; for float64 as in `optimise.line_search`.
ROUNDOFF_SHARE = {torch.float64: ROUNDOFF, torch.float32: 1e-5}
# Eigenvalues of a Hessian that is not positive are turned and kept above this share of the largest.
SMALLEST_CURVATURE = 1e-6


@dataclass(frozen=True, eq=False)
class BatchedSolution:
    """The record of one step of n instances.

    Attributes:
        value: the potential, J, (n,).
        gradient_norm: of its gradient, N, (n,).
        iterations, evaluations: (n,) int64.
        reason: why each stopped, (n,) int64 (`optimise.solution.Reason`).
    """

    value: Tensor
    gradient_norm: Tensor
    iterations: Tensor
    evaluations: Tensor
    reason: Tensor

    @property
    def converged(self) -> Tensor:
        """(n,) bool."""
        return self.reason == int(Reason.CONVERGED)

    @property
    def lost(self) -> Tensor:
        """The instances that had no finite energy to start from and were left where they were, by number."""
        return torch.nonzero(self.reason == int(Reason.INFINITE_START)).flatten()


class _Line(NamedTuple):
    """Lines z + α d to search: E and slope at α = 0."""

    z: Tensor
    d: Tensor
    value: Tensor
    slope: Tensor

    def of(self, rows: Tensor) -> _Line:
        return _Line(*(values[rows] for values in self))


def minimise(
    model: BatchedModel,
    loads: BatchedLoads,
    predictor: Tensor,
    start: Tensor,
    z: Tensor,
    tolerance: float,
    most: int,
) -> tuple[Tensor, BatchedSolution]:
    """Minimise E of every instance until ‖∇E‖ ≤ tolerance · max(‖z‖, 1) (paper, Sec. 5.2).

    Args:
        start: first guesses, (n, r); z takes their place where their energy is infinite.
        most: the largest number of iterations.

    Returns:
        The minimisers, (n, r), never worse than the guess beyond rounding, and the record.
    """
    value, g = model.value_gradient(loads, predictor, start)
    evaluations = torch.ones(len(z), dtype=torch.int64, device=z.device)
    z = torch.where((value < torch.inf)[:, None], start, z)
    outside = torch.nonzero(~(value < torch.inf)).flatten()
    if len(outside):
        value[outside], g[outside] = model.value_gradient(loads.of(outside), predictor[outside], z[outside])
        evaluations[outside] += 1
    iterations = torch.zeros_like(evaluations)
    reason = torch.where(value < torch.inf, RUNNING, int(Reason.INFINITE_START))
    for iteration in range(most + 1):
        small = g.norm(dim=1) <= tolerance * z.norm(dim=1).clamp(min=1)
        reason = torch.where((reason == RUNNING) & small, int(Reason.CONVERGED), reason)
        running = torch.nonzero(reason == RUNNING).flatten()
        if len(running) == 0 or iteration == most:
            break
        part, ahead = loads.of(running), predictor[running]
        d = newton_direction(model.hessian(part, ahead, z[running]), g[running])
        line = _Line(z[running], d, value[running], (g[running] * d).sum(1))
        found, z_new, value_new, g_new, tried = _search(model, part, ahead, line)
        evaluations[running] += tried
        reason[running[~found]] = int(Reason.NO_DECREASE)
        moved = running[found]
        z[moved], value[moved], g[moved] = z_new[found], value_new[found], g_new[found]
        iterations[moved] += 1
    reason = torch.where(reason == RUNNING, int(Reason.ITERATIONS_SPENT), reason)
    norm = torch.where(value < torch.inf, g.norm(dim=1), torch.inf)
    return z, BatchedSolution(value, norm, iterations, evaluations, reason)


def newton_direction(H: Tensor, g: Tensor) -> Tensor:
    """−H⁻¹ g, (n, r); where H (n, r, r) is not positive, with its eigenvalues' magnitudes instead: a way down."""
    factor, failed = torch.linalg.cholesky_ex(H)
    d = -torch.cholesky_solve(g[:, :, None], factor)[:, :, 0]
    bad = torch.nonzero((failed > 0) | ~torch.isfinite(d).all(1)).flatten()
    if len(bad):
        values, vectors = torch.linalg.eigh(torch.nan_to_num(H[bad]))
        size = values.abs()
        size = torch.maximum(size, SMALLEST_CURVATURE * size.amax(1, keepdim=True)).clamp(min=1e-300)
        d[bad] = -(vectors @ ((vectors.transpose(1, 2) @ g[bad][:, :, None]) / size[:, :, None]))[:, :, 0]
    return d


def _search(
    model: BatchedModel, loads: BatchedLoads, predictor: Tensor, line: _Line
) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
    """Backtracking along each line; whether a step was accepted, and z, E, ∇E and the evaluations made."""
    count = len(line.z)
    length = torch.ones_like(line.value)
    found = torch.zeros(count, dtype=torch.bool, device=length.device)
    tried = torch.zeros(count, dtype=torch.int64, device=length.device)
    z, value, g = line.z.clone(), line.value.clone(), torch.zeros_like(line.z)
    rows = torch.nonzero(torch.isfinite(line.slope) & (line.slope < 0)).flatten()
    smallest = torch.finfo(length.dtype).eps * line.z.norm(dim=1)
    for _ in range(MAX_BACKTRACKS):
        if len(rows) == 0:
            break
        part = line.of(rows)
        trial = part.z + length[rows, None] * part.d
        E, gradient = model.value_gradient(loads.of(rows), predictor[rows], trial)
        slope = (gradient * part.d).sum(1)
        tried[rows] += 1
        good = accepts(part, length[rows], E, slope)
        taken = rows[good]
        z[taken], value[taken], g[taken], found[taken] = trial[good], E[good], gradient[good], True
        length[rows] = next_length(part, length[rows], E, slope)
        still = ~good & (length[rows] * part.d.norm(dim=1) > smallest[rows])
        rows = rows[still]
    return found, z, value, g, tried


def accepts(line: _Line, length: Tensor, value: Tensor, slope: Tensor) -> Tensor:
    """`line_search.accepts` for a batch: sufficient decrease, or its form in the slopes at the level of rounding."""
    near = (value - line.value).abs() <= ROUNDOFF_SHARE[value.dtype] * line.value.abs()
    by_slope = (RISEN * line.slope <= slope) & (slope <= -FALLEN * line.slope)
    by_value = value <= line.value + ARMIJO * length * line.slope
    return (value < torch.inf) & torch.where(near, by_slope, by_value)


def next_length(line: _Line, length: Tensor, value: Tensor, slope: Tensor) -> Tensor:
    """`line_search.next_step` for a batch."""
    near = (value - line.value).abs() <= ROUNDOFF_SHARE[value.dtype] * line.value.abs()
    secant = (line.slope / (line.slope - slope).clamp(max=-1e-300)).clamp(SHORTEST, LONGEST)
    by_slope = length * torch.where(slope > line.slope, secant, LONGEST)
    curvature = value - line.value - line.slope * length
    parabola = (-0.5 * line.slope * length**2 / curvature).clamp(min=SHORTEST * length, max=HALF * length)
    by_value = torch.where(curvature > 0, parabola, HALF * length)
    return torch.where(value < torch.inf, torch.where(near, by_slope, by_value), AFTER_INFINITE * length)
