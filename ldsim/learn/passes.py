"""Rows of poses and their changes through an activation: out, back, and the gradient of a loss both ways; compiled.

Rows are b poses and rest, then changes along v and along w of each pose and r of rest (`ldsim/learn/potential.py`).
"""

from __future__ import annotations

from ldsim.arrays import Numbers
from ldsim.jit import kernel
from ldsim.space.activation import activate, slope


@kernel()
def _curvatures(kind: int, y: float) -> tuple[float, float]:
    """Second and third derivative of an activation in terms of its value y, as `slope` has the first."""
    if kind == 0:
        return (0.0, 0.0) if y > 0.0 else (y + 1.0, y + 1.0)
    if kind == 1:
        return 0.0, 0.0
    if kind == 2:
        s = 1.0 - y * y
        return -2.0 * y * s, s * (6.0 * y * y - 2.0)
    s = y * (1.0 - y)
    return s * (1.0 - 2.0 * y), s * (1.0 - 6.0 * s)


@kernel()
def pass_out(
    kind: int, bias: Numbers, moved: Numbers, derivatives: tuple[Numbers, Numbers, Numbers], x: Numbers
) -> None:
    """Apply the activation, in place, to the leading rows of x, of poses and rest, and write its derivatives there.

    Args:
        moved: changes of what an activation is given, (2b + r, n); those of what it gives are the rows of x below.
        derivatives: room for the first, second and third, (b + 1, n) each.
    """
    slopes, curvatures, thirds = derivatives
    poses, n = slopes.shape
    for i in range(poses):
        for j in range(n):
            x[i, j] += bias[j]
        activate(kind, x[i])
        for j in range(n):
            slopes[i, j] = slope(kind, x[i, j])
            curvatures[i, j], thirds[i, j] = _curvatures(kind, x[i, j])
    for i in range(moved.shape[0]):
        at = _pose_of(i, poses)
        for j in range(n):
            x[poses + i, j] = moved[i, j] * slopes[at, j]


@kernel()
def _pose_of(i: int, poses: int) -> int:
    """Whose change the i-th is: along v and along w of each pose but the last, which is rest, and then of that."""
    return i % (poses - 1) if i < 2 * (poses - 1) else poses - 1


@kernel()
def pass_back(back: Numbers, first: Numbers, second: Numbers, moved: Numbers, out: Numbers) -> None:
    """Forces on what an activation gives, and their changes along v, to those on what it is given."""
    b = back.shape[0] // 2
    for i in range(b):
        for j in range(back.shape[1]):
            s, change = first[i, j], second[i, j] * moved[i, j]
            out[i, j] = back[i, j] * s
            out[b + i, j] = back[b + i, j] * s + back[i, j] * change


@kernel()
def pass_back_adjoint(
    counted: Numbers,
    back: Numbers,
    derivatives: tuple[Numbers, Numbers, Numbers],
    moved: Numbers,
    on_back: Numbers,
    on_value: Numbers,
    on_moved: Numbers,
) -> None:
    """The adjoint of `pass_back`: of a loss's gradients by what came out, those by what came in.

    Args:
        counted: by what came out. on_back: by what came in.
        on_value, on_moved: by what the activation was given, and by its changes along v.
    """
    first, second, third = derivatives
    b = back.shape[0] // 2
    for i in range(b):
        for j in range(back.shape[1]):
            s, k, t = first[i, j], second[i, j], moved[i, j]
            value, other = counted[i, j], counted[b + i, j]
            on_back[i, j] = value * s + other * k * t
            on_back[b + i, j] = other * s
            on_change = other * back[i, j]
            on_value[i, j] = (value * back[i, j] + other * back[b + i, j]) * k + on_change * third[i, j] * t
            on_moved[i, j] = on_change * k


@kernel()
def pass_out_adjoint(
    counted: Numbers, first: Numbers, second: Numbers, moved: Numbers, beside: tuple[Numbers, Numbers], out: Numbers
) -> None:
    """The adjoint of `pass_out`; beside it what `pass_back_adjoint` gives by poses and by their changes along v."""
    on_value, on_moved = beside
    poses, n = first.shape
    for i in range(poses):
        for j in range(n):
            out[i, j] = counted[i, j] * first[i, j] + (on_value[i, j] if i < poses - 1 else 0.0)
    for i in range(moved.shape[0]):
        at = _pose_of(i, poses)
        for j in range(n):
            out[at, j] += counted[poses + i, j] * moved[i, j] * second[at, j]
            out[poses + i, j] = counted[poses + i, j] * first[at, j] + (on_moved[i, j] if i < poses - 1 else 0.0)
