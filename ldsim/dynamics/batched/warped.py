"""The springs of grabs in a condensed space, of many instances and differentiable: reduced/warped.py on tensors.

In a step they are springs of unit stiffness, made at the state in which it begins. So a batch of a condensed space is
stepped as any other, and gradients reach the state, targets, stiffness, gravity and moduli through the making of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from ldsim.arrays import Array, Indices
from ldsim.dynamics.reduced.in_series import InSeries
from ldsim.dynamics.reduced.warped import BENT_STEPS
from ldsim.mechanics.elastic import PAIRS
from ldsim.mechanics.grabs import Grab
from ldsim.space.compliance import LEAST_STRETCH, MOST_CHANGED, TURNED
from ldsim.space.space import Space

# Roots have no slope at 0.
TINY = 1e-60


class BatchedSeries(NamedTuple):
    """What some grabs of n instances have as long as they hold the same vertices, g each; zeros where there are fewer.

    The first seven are of `InSeries`: B (n, 3g, k), centre (n, 3g) at rest without weight, compliance (n, 3g, 3g),
    gradient (n, g, 3, 3, k), coupling (n, g, r, 3, 3), second (n, g, 3, 3, 3), root (n, g, 3, 3). dead (n, 3g), m, and
    weight (n, 3g, 3), s²: what dead loads and gravity move the centroids beside the coordinates. which (n, g): of
    `held`, the vertices that each holds, or −1.
    """

    B: Tensor
    centre: Tensor
    compliance: Tensor
    gradient: Tensor
    coupling: Tensor
    second: Tensor
    root: Tensor
    dead: Tensor
    weight: Tensor
    which: Tensor
    held: tuple[Indices, ...]

    @classmethod
    def of(cls, space: Space, grabs: Sequence[Sequence[Grab]], tensor: Callable[[object], Tensor]) -> BatchedSeries:
        """Those of the grabs of each instance."""
        assert space.compliance is not None
        n, most, k = len(grabs), max((len(each) for each in grabs), default=0), space.decoder.k
        rest, sags = space.scene.mesh.vertices, space.compliance.sags()
        held: dict[int, Indices] = {}
        known: dict[tuple[int, ...], tuple[Array, ...]] = {}
        sizes = (3 * most, k), (3 * most,), (3 * most, 3 * most), (most, 3, 3, k), (most, space.r, 3, 3)
        shapes = *sizes, (most, 3, 3, 3), (most, 3, 3), (3 * most,), (3 * most, 3)
        arrays = [np.zeros((n, *shape)) for shape in shapes]
        which = np.full((n, most), -1)
        for i, own in enumerate(grabs):
            vertices = [grab.vertices for grab in own]
            key = tuple(map(id, vertices))
            if own and key not in known:
                series = InSeries.of(space, own, None)
                centre = np.concatenate([rest[v].mean(axis=0) for v in vertices])
                sunk = [np.concatenate([field[v].mean(axis=0) for v in vertices]) for field in sags]
                laws = series.gradient, series.coupling, series.second, series.root
                known[key] = series.B, centre, series.compliance, *laws, *sunk
            for array, values in zip(arrays, known[key] if own else (), strict=bool(own)):
                array[i][tuple(slice(size) for size in values.shape)] = values
            for j, v in enumerate(vertices):
                held.setdefault(id(v), v)
                which[i, j] = list(held).index(id(v))
        tensors = [tensor(array) for array in arrays]
        return cls._make([*tensors, torch.as_tensor(which, device=tensors[0].device), tuple(held.values())])

    def of_instances(self, instances: Tensor | slice) -> BatchedSeries:
        """Those of some instances."""
        return BatchedSeries._make([*(values[instances] for values in self[:-1]), self.held])


class Swing(NamedTuple):
    """How modes move in a step, y = follows x + swung + gives f (space/modes.py): (n, m) each, gives in s².

    softness (n, m): ω⁻², s². sunk (n, m): how far weight has them. relaxed (n, k): φ(z) where the step begins. turns:
    whether what they have of a dent turns with the place that is held.
    """

    follows: Tensor
    gives: Tensor
    swung: Tensor
    softness: Tensor
    sunk: Tensor
    relaxed: Tensor
    turns: bool


class Pulled(NamedTuple):
    """What grabs do at coordinates q: springs of unit stiffness, B (n, g, 3, k), centre and target (n, g, 3).

    And of each what its dent is made of: A (n, g, 3, 3), C^-½, D and N z as `Dent` has them, and Aᵀ f, (n, g, 3), N.
    forces (n, 3g, 3g): what makes forces of the ways of the unit springs. turned (n, 3g, m), given (n, m): of modes
    that swing, as `InSeries` has them.
    """

    B: Tensor
    centre: Tensor
    target: Tensor
    warps: Tensor
    root: Tensor
    second: Tensor
    coupled: Tensor
    force: Tensor
    forces: Tensor
    turned: Tensor
    given: Tensor

    def amounts(self) -> Tensor:
        """How much of each of `Compliance.fields` they make, (n, g, 9), N and N²."""
        force, root = self.force, self.root
        single = force + torch.einsum("ngij,ngjk,ngkl,ngl->ngi", root, root, self.coupled, force)
        at = _limit(root, torch.einsum("ngijk,ngk->ngij", self.second, force))[..., None] * force
        pairs = at[..., :, None] * (force - 0.5 * at)[..., None, :]
        both = [pairs[..., i, j] if i == j else pairs[..., i, j] + pairs[..., j, i] for i, j in PAIRS]
        return torch.cat([single, torch.stack(both, dim=-1)], dim=-1)


def pulled(
    series: BatchedSeries,
    target: Tensor,
    stiffness: Tensor,
    gravity: Tensor,
    softness: Tensor,
    q: Tensor,
    swing: Swing | None = None,
    stepping: bool = True,
) -> Pulled:
    """See reduced/warped.py, which has the formulas.

    Args:
        target: (n, g, 3), m. stiffness: (n, g), N/m, zero for no grab. gravity: (n, 3). softness: (n,), how much softer
            than the scene each solid is.
        q: where the step begins, (n, k).
        swing: how modes move in it; None where there are none.
        stepping: whether the springs are those of a step; otherwise what grabs do at q itself.
    """
    n, g = stiffness.shape
    modes = 0 if swing is None else swing.swung.shape[1]
    strays = q[:, :0]
    if swing is not None:
        strays, q = q[:, -modes:] - swing.relaxed[:, -modes:] - swing.sunk, swing.relaxed
    soft = softness[:, None, None, None]
    root = series.root / soft.sqrt()
    A, R, inverse = warps(
        torch.eye(3, dtype=q.dtype, device=q.device) + torch.einsum("ngijk,nk->ngij", series.gradient, q)
    )
    trace = R.diagonal(dim1=-2, dim2=-1).sum(-1)
    coupling = soft[..., None] * series.coupling
    coupled = torch.einsum("nf,ngfij->ngij", q[:, : coupling.shape[2]], coupling)
    share = (1 - (3 - trace) / TURNED**2).clamp_min(0) ** 2 * _limit(root, coupled)
    coupled = share[..., None, None] * coupled

    centre = series.centre + softness[:, None] * (series.dead + torch.einsum("nia,na->ni", series.weight, gravity))
    held = series.B[..., series.B.shape[2] - modes :]
    turns = swing is not None and swing.turns
    way = target.reshape(n, 3 * g) - centre - torch.einsum("nik,nk->ni", series.B, q)
    between = soft[..., None] * series.compliance.reshape(n, g, 3, g, 3)
    # 1 + √K M √K in the place of 1/K + M: a grab that was let go has a stiffness of zero
    stiff = torch.where(stiffness > 0, stiffness, 1.0).sqrt() * (stiffness > 0)
    stiff = stiff.repeat_interleave(3, dim=1)
    one = torch.eye(3 * g, dtype=q.dtype, device=q.device)

    def aimed(change: Tensor, aside: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """M while modes stay, the factor of 1 + √K M √K, the forces, (n, 3g), and how modes move centroids."""
        own = torch.diag_embed(change.permute(0, 2, 3, 1)).permute(0, 3, 1, 4, 2)  # (n, g, 3, g, 3)
        M = torch.einsum("ngia,ngahb,nhjb->ngihj", A, between + own, A).reshape(n, 3 * g, 3 * g)
        M, turned = 0.5 * (M + M.transpose(1, 2)), held
        if swing is not None and turns:
            share = (1 - (root @ change @ root).square().sum((-2, -1)).clamp_min(TINY).sqrt()).clamp_min(TINY).sqrt()
            turned = torch.einsum("ng,ngia,ngam->ngim", share, A, held.reshape(n, g, 3, modes)).flatten(1, 2)
            M = M - torch.einsum("nim,nm,njm->nij", turned, swing.softness, turned)
        L, _ = torch.linalg.cholesky_ex(one + stiff[:, :, None] * M * stiff[:, None])
        reached = way - torch.einsum("nim,nm->ni", turned, strays) + aside
        f = stiff * torch.cholesky_solve((stiff * reached)[:, :, None], L)[:, :, 0]
        return M, L, f, turned

    aside = torch.zeros_like(way)
    M, L, f, turned = aimed(coupled, aside)
    bodies = torch.zeros_like(f).reshape(n, g, 3)
    second = soft[..., None] ** 2 * series.second
    for _ in range(BENT_STEPS if bool(series.second.any() or series.coupling.any()) else 0):
        bodies = torch.einsum("ngia,ngi->nga", A, f.reshape(n, g, 3))
        bent = torch.einsum("ngijk,ngk->ngij", second, bodies)
        taken = _limit(root, bent)[..., None, None]
        aside = torch.einsum("ngia,ngab,ngb->ngi", A, 0.5 * taken**2 * bent, bodies).reshape(n, 3 * g)
        M, L, f, turned = aimed(coupled + taken * bent, aside)
    dents = torch.einsum("nij,nj->ni", M, f) - aside
    given = torch.einsum("nim,ni->nm", turned, f)
    if swing is not None:
        given = given * swing.softness
        dents = dents + torch.einsum("nim,nm->ni", turned, strays) if turns else dents
    dents = dents.reshape(n, g, 3)

    H = 0.75 * torch.einsum("ngbc,ngc,ngibk->ngik", inverse, dents, series.gradient)
    H = H - 0.25 * torch.einsum("ngbi,nga,ngabk->ngik", inverse, dents, series.gradient)
    changed = 0.5 * share[..., None, None] * torch.einsum("ngia,ngfab,ngb->ngif", A, coupling, bodies)
    H = (H + torch.nn.functional.pad(changed, (0, H.shape[3] - changed.shape[3]))).flatten(1, 2)
    base, levers = centre - torch.einsum("nik,nk->ni", H, q) - aside, series.B + H
    if swing is not None and stepping:
        base = base + torch.einsum("nim,nm->ni", turned, swing.swung - swing.sunk)
        own = levers[..., -modes:] - (1 - swing.follows)[:, None] * turned
        levers = torch.cat([levers[..., :-modes], own], dim=2)
        M = M + torch.einsum("nim,nm,njm->nij", turned, swing.gives, turned)
        L, _ = torch.linalg.cholesky_ex(one + stiff[:, :, None] * M * stiff[:, None])
    rows = torch.cat([levers, base[:, :, None], target.reshape(n, 3 * g, 1)], dim=2)
    rows = torch.linalg.solve_triangular(L, stiff[:, :, None] * rows, upper=False).unflatten(1, (g, 3))
    own = torch.einsum("ngia,ngi->nga", A, f.reshape(n, g, 3))
    forces = torch.linalg.solve_triangular(L.transpose(1, 2), one.expand_as(L), upper=True) * stiff[:, :, None]
    springs = rows[..., :-2], rows[..., -2], rows[..., -1]
    return Pulled(*springs, A, root, second, coupled, own, forces, turned, given)


def _limit(root: Tensor, change: Tensor) -> Tensor:
    """How much of a change of C is taken, (n, g), at most 1."""
    square = (root @ change @ root).square().sum((-2, -1))
    return MOST_CHANGED / square.clamp_min(MOST_CHANGED**2).sqrt()


def warps(F: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """R U^½, R and F⁻¹ of F = R U, (…, 3, 3), U at least `LEAST_STRETCH`; differentiable for equal stretches too."""
    A, R, transposed = _Warps.apply(F)  # type: ignore[no-untyped-call]
    return A, R, transposed.transpose(-2, -1)


class _Warps(torch.autograd.Function):
    """Functions P f(σ) Vᵀ of F = P σ Vᵀ: √σ, 1 and 1/σ."""

    @staticmethod
    def forward(ctx: Any, F: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        P, stretch, Vt = torch.linalg.svd(F)
        stretch = stretch.clone()
        for turn, last in ((P, P[..., :, 2]), (Vt, Vt[..., 2, :])):
            sign = torch.linalg.det(turn).sign()
            last *= sign[..., None]  # a view: both are rotations then, and the last stretch has the sign of det F
            stretch[..., 2] *= sign
        ctx.save_for_backward(P, stretch, Vt)
        least = stretch.clamp_min(LEAST_STRETCH)
        found = [(P * f[..., None, :]) @ Vt for f in (least.sqrt(), torch.ones_like(least), 1 / least)]
        return found[0], found[1], found[2]

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> Tensor:
        P, stretch, Vt = ctx.saved_tensors
        least, free = stretch.clamp_min(LEAST_STRETCH), (stretch > LEAST_STRETCH).to(stretch.dtype)
        functions = least.sqrt(), torch.ones_like(least), 1 / least
        slopes = 0.5 * free / least.sqrt(), torch.zeros_like(least), -free / least**2
        turned = torch.zeros_like(P)
        for gradient, f, slope in zip(gradients, functions, slopes, strict=True):
            G = P.transpose(-2, -1) @ gradient @ Vt.transpose(-2, -1)
            turned = turned + 0.5 * (_divided(stretch, f, slope, -1) * (G + G.transpose(-2, -1)))
            turned = turned + 0.5 * (_divided(stretch, f, slope, +1) * (G - G.transpose(-2, -1)))
        found: Tensor = P @ turned @ Vt
        return found


def _divided(x: Tensor, f: Tensor, slope: Tensor, sign: int) -> Tensor:
    """(fᵢ + s fⱼ) / (xᵢ + s xⱼ) for a sign s, where nothing is to divide by the slope, (…, 3, 3)."""
    above, below = f[..., :, None] + sign * f[..., None, :], x[..., :, None] + sign * x[..., None, :]
    equal = below.abs() < torch.finfo(x.dtype).eps ** 0.5
    return torch.where(equal, 0.5 * (slope[..., :, None] + slope[..., None, :]), above / torch.where(equal, 1.0, below))
