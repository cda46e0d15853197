"""The springs of grabs in a condensed space: in series with its residual compliance, which warps with the solid.

A spring that pulls at the centroid of some vertices acts in series with C (space/compliance.py), which is known at
rest. Where the solid is held it may have turned by then: what was soft across a rod is soft across it still. So a force
is turned back, C at rest is applied, and what that moves is turned again, C ≈ A C₀ Aᵀ with one A = R a grab, as warping
does to stiffness (Müller et al. 2002, "Stable real-time deformations"); and what is stretched gives way further, so A =
R U^½ of the deformation gradient F = R U around it (`space.compliance.warp`). It is that of the state in which a step
begins.

To the next order C changes with the coordinates z, the first of q, and with the force itself (space/compliance.py,
`Dent`), d = (C + N z) f + ½ D(f, f). A step sees the tangent of that at the force f₀ with which it begins: C + N z +
D f₀ for C, and a way that is longer by ½ A D(f₀, f₀).

The spring holds the solid by the end of the dent x = A d that it makes, and A d moves with q as well: that is a lever
on which the force turns and stretches the solid, H = ∂(A d)/∂q at fixed d. With L_j = ∂F/∂q_j F⁻¹, to first order in
the stretch, ∂A/∂q_j = (skew L_j + ½ sym L_j) A, so H_j = (¾ L_j − ¼ L_jᵀ) x, and of N, whose energy is ½ fᵀ N z f, ½ A
N_j Aᵀ f beside it.

Modes that swing (space/modes.py) change nothing of that where they stand still: they have their part of C only as far
as they have followed the force. With x what the relaxed pose φ(z) has of them, y what they are, and w what moves them
besides, their weight, the centroid is where the law above has it, less what they have not done yet,

    c = centre + B φ(z) + A d + θ A B (y − x − ω⁻² (w + (θ A B)ᵀ f))

Here C, D and N are of the whole solid, and A is that of the relaxed pose. With y fixed a grab gives way by what modes
have no part in, A (C + N z + D f₀) Aᵀ − θ² A B ω⁻² (A B)ᵀ, and within a step by θ² A B g (A B)ᵀ more. Their share
θ² = 1 − ‖C^-½ (N z + D f₀) C^-½‖ of a grab keeps that positive: where a dent has become stiffer by half, it is not by
half of a part that is nearly all of it.

Where what modes have of a dent does not turn, as of a trunk that bends between its pins and the grip, C, D and N are of
what they have no part in, and B stands in the place of θ A B.
"""

from __future__ import annotations

import math

from ldsim.arrays import Array
from ldsim.dynamics.reduced.in_series import InSeries
from ldsim.dynamics.reduced.minimiser import cholesky
from ldsim.dynamics.reduced.potential import Reduced, Springs, Work
from ldsim.jit import copy, kernel
from ldsim.mechanics.elastic import PAIRS
from ldsim.mechanics.materials.tensors import Matrix, product_transposed, signed_svd
from ldsim.space.compliance import LEAST_STRETCH, MOST_CHANGED, unturned
from ldsim.space.decoder import REASSOCIATE, decode

# Newton steps for the forces of bent laws.
BENT_STEPS = 3


@kernel()
def warp_springs(series: InSeries, model: Reduced, coordinates: Array, springs: Springs, work: Work) -> None:
    """Write the springs, and all else that the series says, for a state with coordinates (k,), and modes as `swung`.

    Their energy ½ pᵀ (diag(1/k) + A B C Bᵀ Aᵀ)⁻¹ p couples all grabs. With the Cholesky factor L of what is inverted it
    is ½ ‖L⁻¹ p‖²: springs of unit stiffness on L⁻¹ B, which the kernel of a step knows.
    """
    _stray(series, model, coordinates, work)
    q = work.q
    for g in range(series.warps.shape[0]):
        _warp(series, g, q)
        if not series.linear:
            _couple(series, g, q)
        _turn(series, g)
    series.aside[:] = 0.0
    _aim(series, q, model.squares)
    # Newton's method for the forces, from the law that is linear in them
    for _ in range(0 if series.linear else BENT_STEPS):
        for g in range(series.warps.shape[0]):
            _bend(series, g)
            _turn(series, g)
        _aim(series, q, model.squares)
    _give(series, model.squares)
    for g in range(series.warps.shape[0]):
        _lever(series, model, g, q)
    if series.swung.shape[0] > 0:
        _swing(series, model.squares, model.gives)
        _factorise(series)
    for i in range(series.softness.shape[0]):
        _combine(series, i, springs)


@kernel()
def _stray(series: InSeries, model: Reduced, coordinates: Array, work: Work) -> None:
    """Leave φ(z) of a state in work.q, and how far its modes are from where that and their weight have them."""
    modes = series.swung.shape[0]
    if modes == 0:
        copy(coordinates, work.q)
        return
    q, first = work.q, coordinates.shape[0] - modes
    decode(model.layers, coordinates[: work.g.shape[0]], work.hidden, q)  # a condensed space decodes z to itself
    for f in range(modes):
        sunk = model.force[first + f] / (model.follows[f] * model.squares[f])
        series.strays[f] = coordinates[first + f] - q[first + f] - sunk


@kernel()
def _turn(series: InSeries, g: int) -> None:
    """The columns of B of modes, of one grab, times θ A where they turn."""
    A, B, modes, share = series.warps, series.B, series.swung.shape[0], 1.0
    first = B.shape[1] - modes
    if modes > 0 and series.turns and not series.linear:
        share = math.sqrt(max(1.0 - _size(series.root, series.changes, g), 0.0))
    for i in range(3):
        for f in range(modes):
            series.turned[3 * g + i, f] = B[3 * g + i, first + f]
            if series.turns:
                series.turned[3 * g + i, f] = share * (
                    A[g, i, 0] * B[3 * g, first + f]
                    + A[g, i, 1] * B[3 * g + 1, first + f]
                    + A[g, i, 2] * B[3 * g + 2, first + f]
                )


@kernel()
def _give(series: InSeries, squares: Array) -> None:
    """How far grabs move modes where nothing swings; and what these have done of it is of the dents."""
    turned, given = series.turned, series.given
    for f in range(given.shape[0]):
        given[f] = 0.0
        for i in range(turned.shape[0]):
            given[f] += turned[i, f] * series.forces[i]
        given[f] /= squares[f]
    for i in range(turned.shape[0] if series.turns else 0):
        for f in range(given.shape[0]):
            series.dents[i] += turned[i, f] * series.strays[f]


@kernel()
def most_beside(series: InSeries, products: Array, amounts: Array) -> float:
    """The most that the dents of a state can be, ‖A d‖ ≤ ‖A‖ ‖d‖ in the mass norm, kg^½ m, from what is written for it.

    Args:
        products: of the fields of each dent in the mass, `Workspace.dents`. amounts: room for `Dent.amounts`, (9,).
    """
    total, root, second, forces = 0.0, series.root, series.second, series.forces
    for g in range(series.warps.shape[0]):
        A, b, bent = series.warps[g], amounts[:3], series.bent
        for a in range(3):
            b[a] = A[0, a] * forces[3 * g] + A[1, a] * forces[3 * g + 1] + A[2, a] * forces[3 * g + 2]
        for i in range(3):
            for j in range(3):
                bent[g, i, j] = second[g, i, j, 0] * b[0] + second[g, i, j, 1] * b[1] + second[g, i, j, 2] * b[2]
        taken = _limit(root, bent, g)
        taken *= 1.0 - 0.5 * taken
        for e in range(6):
            i, j = PAIRS[e]
            amounts[3 + e] = (1.0 if i == j else 2.0) * taken * b[i] * b[j]
        x, y, z = _applied(series.coupled[g], b[0], b[1], b[2])
        x, y, z = _applied(root[g], x, y, z)
        x, y, z = _applied(root[g], x, y, z)
        b[0], b[1], b[2] = b[0] + x, b[1] + y, b[2] + z
        size, square = 0.0, 0.0
        for i in range(3):
            for j in range(3):
                size += A[i, j] ** 2
        for i in range(products.shape[1]):
            for j in range(products.shape[1]):
                square += amounts[i] * products[g, i, j] * amounts[j]
        total += math.sqrt(size * max(square, 0.0))
    square = 0.0
    for f in range(series.given.shape[0] if series.turns else 0):
        square += series.given[f] ** 2
    return total + math.sqrt(square)


@kernel()
def _applied(M: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """M (x, y, z)."""
    return (
        M[0, 0] * x + M[0, 1] * y + M[0, 2] * z,
        M[1, 0] * x + M[1, 1] * y + M[1, 2] * z,
        M[2, 0] * x + M[2, 1] * y + M[2, 2] * z,
    )


@kernel()
def _aim(series: InSeries, q: Array, squares: Array) -> None:
    """The factor and its inverse, and forces and dents by them."""
    _soften(series, squares)
    _factorise(series)
    _dent(series, q)


@kernel()
def _soften(series: InSeries, squares: Array) -> None:
    """What grabs and springs give way by while modes stay where they are, which is to be factorised."""
    n, L, turned = series.softness.shape[0], series.factor, series.turned
    for g in range(series.warps.shape[0]):
        for h in range(g + 1):
            _warped_pair(series, g, h, L)
    for i in range(n):
        for j in range(i + 1):
            for f in range(squares.shape[0] if series.turns else 0):
                L[i, j] -= turned[i, f] / squares[f] * turned[j, f]
        L[i, i] += series.softness[i]


@kernel()
def _swing(series: InSeries, squares: Array, gives: Array) -> None:
    """Within a step modes give way too, by what their mass lets them."""
    _soften(series, squares)
    turned = series.turned
    for i in range(turned.shape[0]):
        for j in range(i + 1):
            for f in range(gives.shape[0]):
                series.factor[i, j] += turned[i, f] * gives[f] * turned[j, f]


@kernel()
def _factorise(series: InSeries) -> None:
    n, L, pull = series.softness.shape[0], series.factor, series.pull
    cholesky(L)
    for i in range(n):
        for j in range(n):
            pull[j, i] = 1.0 if i == j else 0.0
        for j in range(i):
            for h in range(j + 1):
                pull[h, i] -= L[i, j] * pull[h, j]
        for h in range(i + 1):
            pull[h, i] /= L[i, i]


@kernel()
def _couple(series: InSeries, g: int, q: Array) -> None:
    """How one grab's C changes with the coordinates: N z, as much of it as is taken."""
    N, coupled = series.coupling, series.coupled
    for i in range(3):
        for j in range(3):
            coupled[g, i, j] = 0.0
            for f in range(N.shape[1]):
                coupled[g, i, j] += q[f] * N[g, f, i, j]
    series.shares[g] *= _limit(series.root, coupled, g)
    for i in range(3):
        for j in range(3):
            coupled[g, i, j] *= series.shares[g]
            series.changes[g, i, j] = coupled[g, i, j]


@kernel()
def _bend(series: InSeries, g: int) -> None:
    """The tangent of one grab's law at the force that it has: D f₀ beside N z, and ½ A D(f₀, f₀)."""
    A, D, f, change = series.warps, series.second, series.bodies, series.changes
    for a in range(3):
        f[g, a] = 0.0
        for i in range(3):
            f[g, a] += A[g, i, a] * series.forces[3 * g + i]
    bent = series.bent
    for i in range(3):
        for j in range(3):
            bent[g, i, j] = D[g, i, j, 0] * f[g, 0] + D[g, i, j, 1] * f[g, 1] + D[g, i, j, 2] * f[g, 2]
    taken = _limit(series.root, bent, g)
    for i in range(3):
        series.aside[3 * g + i] = 0.0
    for a in range(3):
        beside = 0.0
        for b in range(3):
            change[g, a, b] = series.coupled[g, a, b] + taken * bent[g, a, b]
            beside += 0.5 * taken**2 * bent[g, a, b] * f[g, b]
        for i in range(3):
            series.aside[3 * g + i] += A[g, i, a] * beside


@kernel()
def _limit(root: Array, change: Array, g: int) -> float:
    """How much of a change of one grab's C is taken, at most 1."""
    size = _size(root, change, g)
    return 1.0 if size <= MOST_CHANGED else MOST_CHANGED / size


@kernel()
def _size(root: Array, change: Array, g: int) -> float:
    """How large a change of one grab's C is beside it, ‖C^-½ change C^-½‖."""
    size = 0.0
    for i in range(3):
        for j in range(3):
            entry = 0.0
            for a in range(3):
                for b in range(3):
                    entry += root[g, i, a] * change[g, a, b] * root[g, b, j]
            size += entry**2
    return math.sqrt(size)


@kernel(fastmath=REASSOCIATE)
def _warp(series: InSeries, g: int, q: Array) -> None:
    """A and F⁻¹ of one grab: R U^½ of F = R U = I + gradient q, stretched by `LEAST_STRETCH` at least."""
    T = series.gradient
    a, b, c, d, e, h, i, j, k = 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0
    for f in range(q.shape[0]):
        v = q[f]
        a += v * T[g, 0, 0, f]
        b += v * T[g, 0, 1, f]
        c += v * T[g, 0, 2, f]
        d += v * T[g, 1, 0, f]
        e += v * T[g, 1, 1, f]
        h += v * T[g, 1, 2, f]
        i += v * T[g, 2, 0, f]
        j += v * T[g, 2, 1, f]
        k += v * T[g, 2, 2, f]
    P, (x, y, z), V = signed_svd((a, b, c, d, e, h, i, j, k))
    R = product_transposed(P, V)
    series.shares[g] = unturned(R[0] + R[4] + R[8])
    x, y, z = max(x, LEAST_STRETCH), max(y, LEAST_STRETCH), max(z, LEAST_STRETCH)
    A = product_transposed(_scaled(P, math.sqrt(x), math.sqrt(y), math.sqrt(z)), V)
    inverse = product_transposed(_scaled(V, 1 / x, 1 / y, 1 / z), P)
    for e in range(9):
        series.warps[g, e // 3, e % 3], series.inverses[g, e // 3, e % 3] = A[e], inverse[e]


@kernel()
def _scaled(M: Matrix, x: float, y: float, z: float) -> Matrix:
    """The columns of M times x, y and z."""
    return M[0] * x, M[1] * y, M[2] * z, M[3] * x, M[4] * y, M[5] * z, M[6] * x, M[7] * y, M[8] * z


@kernel(fastmath=REASSOCIATE)
def _dent(series: InSeries, q: Array) -> None:
    """Forces f = L⁻ᵀ L⁻¹ (p + aside) of the ways p of the centroids to their targets, and the dents p − f/k."""
    n, way, dents, pull = series.softness.shape[0], series.base, series.dents, series.pull
    for i in range(n):
        way[i] = series.target[i] - series.centre[i]
        for f in range(q.shape[0]):
            way[i] -= series.B[i, f] * q[f]
        for f in range(series.strays.shape[0]):
            way[i] -= series.turned[i, f] * series.strays[f]
    for i in range(n):
        dents[i] = 0.0
        for j in range(i + 1):
            dents[i] += pull[j, i] * (way[j] + series.aside[j])
    for i in range(n):  # row i of L⁻ᵀ has nothing before i, so what was read may be written
        series.forces[i] = 0.0
        for j in range(i, n):
            series.forces[i] += pull[i, j] * dents[j]
        dents[i] = way[i] - series.softness[i] * series.forces[i]


@kernel(fastmath=REASSOCIATE)
def _lever(series: InSeries, model: Reduced, g: int, q: Array) -> None:
    """B + H of one grab, and the centre such that at q nothing is moved but by what the tangent leaves out."""
    follows, squares, force = model.follows, model.squares, model.force
    inverse, gradient, levers, k = series.inverses, series.gradient, series.levers, q.shape[0]
    x, y, z = series.dents[3 * g], series.dents[3 * g + 1], series.dents[3 * g + 2]
    first = k - follows.shape[0]
    for i in range(3):
        row, beside = 3 * g + i, 0.0
        for f in range(k):
            levers[row, f] = series.B[row, f]
        for e in range(9):
            # of ¾ Σ_b T[i, b] (F⁻¹ x)_b − ¼ Σ_ab F⁻¹[b, i] x_a T[a, b], with T = ∂F/∂q
            a, b = e // 3, e % 3
            share = -0.25 * inverse[g, b, i] * series.dents[3 * g + a]
            if a == i:
                share += 0.75 * (inverse[g, b, 0] * x + inverse[g, b, 1] * y + inverse[g, b, 2] * z)
            for f in range(k):
                levers[row, f] += share * gradient[g, a, b, f]
        for f in range(series.coupling.shape[1]):
            levers[row, f] += 0.5 * series.shares[g] * _changed(series, g, i, f)
        for f in range(k):
            beside += (levers[row, f] - series.B[row, f]) * q[f]
        for f in range(follows.shape[0]):
            sunk = force[first + f] / (follows[f] * squares[f])
            beside -= series.turned[row, f] * (series.swung[f] - sunk)
            levers[row, first + f] -= (1.0 - follows[f]) * series.turned[row, f]
        series.base[row] = series.centre[row] - beside - series.aside[row]


@kernel()
def swing_on(series: InSeries, model: Reduced, springs: Springs, q: Array) -> None:
    """Modes at the end of a step, from φ(z) in q, (k,): what follows it, their own motion, the pull of grabs."""
    modes, k = series.swung.shape[0], q.shape[0]
    first = k - modes
    for i in range(series.softness.shape[0]):
        g, axis = i // 3, i % 3
        series.base[i] = springs.target[g, axis] - springs.centre[g, axis]
        for f in range(k):
            series.base[i] -= springs.B[g, axis, f] * q[f]
    for f in range(modes):
        q[first + f] = model.follows[f] * q[first + f] + series.swung[f]
    for i in range(series.softness.shape[0]):
        force = 0.0
        for j in range(i, series.softness.shape[0]):
            force += series.pull[i, j] * series.base[j]
        for f in range(modes):
            q[first + f] += model.gives[f] * force * series.turned[i, f]


@kernel()
def _changed(series: InSeries, g: int, i: int, f: int) -> float:
    """Entry i of A N_f f₀ of one grab."""
    total = 0.0
    for a in range(3):
        for b in range(3):
            total += series.warps[g, i, a] * series.coupling[g, f, a, b] * series.bodies[g, b]
    return total


@kernel()
def _combine(series: InSeries, i: int, springs: Springs) -> None:
    """Row i of L⁻¹ (levers, base, target)."""
    g, axis, k = i // 3, i % 3, springs.B.shape[2]
    springs.centre[g, axis] = springs.target[g, axis] = 0.0
    for f in range(k):
        springs.B[g, axis, f] = 0.0
    for j in range(i + 1):
        share = series.pull[j, i]
        springs.centre[g, axis] += share * series.base[j]
        springs.target[g, axis] += share * series.target[j]
        for f in range(k):
            springs.B[g, axis, f] += share * series.levers[j, f]


@kernel()
def _warped_pair(series: InSeries, g: int, h: int, out: Array) -> None:
    """The block of grabs g and h of A (B C Bᵀ + N z + D f₀) Aᵀ; of C and Cᵀ, which differ by rounding, the mean."""
    C, A = series.compliance, series.warps
    for i in range(3):
        for j in range(3):
            total = 0.0
            for a in range(3):
                for b in range(3):
                    between = 0.5 * (C[3 * g + a, 3 * h + b] + C[3 * h + b, 3 * g + a])
                    if g == h:
                        between += series.changes[g, a, b]
                    total += A[g, i, a] * between * A[h, j, b]
            out[3 * g + i, 3 * h + j] = total
