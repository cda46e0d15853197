"""What the springs of grabs in a condensed space are made of, see reduced/warped.py, which aims them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ldsim.arrays import Array
from ldsim.mechanics.grabs import Grab
from ldsim.space.space import Space


class InSeries(NamedTuple):
    """What some grabs have as long as they hold the same vertices, and what `warp_springs` writes for a state.

    Attributes:
        B, centre: c(q) = centre + B q of all centroids, (3g, k) and (3g,), metres.
        compliance: B C Bᵀ at rest, (3g, 3g), m/N.
        softness: of the springs, 1/k, (3g,).
        gradient: F = I + gradient q of the cells around each (`Compliance.arms`), (g, 3, 3, k).
        coupling, second, root: of `Dent`, (g, r, 3, 3), (g, 3, 3, 3) and (g, 3, 3).
        linear: whether the first two of these are zero.
        target: (3g,), metres, to be written.
        warps, inverses: A and F⁻¹ of each, (g, 3, 3).
        shares: how much of N is taken, (g,).
        coupled, bent, changes: of that N z, all of D f₀, and what is taken of both, (g, 3, 3), m/N.
        bodies: f₀ = Aᵀ f in the solid's frame at rest, (g, 3), N.
        aside: ½ A D(f₀, f₀), (3g,), metres.
        forces, dents: f of all springs, (3g,), N, and A d, (3g,), metres.
        levers: B + H, (3g, k), of modes that swing the share that follows φ(z).
        base: such that base + levers φ is the centre where modes are left to swing, less what is aside, (3g,), metres.
        pull, factor: L⁻ᵀ, which makes forces of the stretch of the unit springs, and L, (3g, 3g).
        swung: where modes go that nothing but their inertia and weight moves, less a times φ(z), (m,).
        turns: whether what modes have of a dent is of C and turns.
        turned: the columns of B of modes, and where they turn θ A times these, (3g, m).
        strays, given: how far modes are from where the relaxed pose and their weight have them, and how far grabs move
            them where nothing swings, (m,).
    """

    B: Array
    centre: Array
    compliance: Array
    softness: Array
    gradient: Array
    coupling: Array
    second: Array
    root: Array
    linear: bool
    target: Array
    warps: Array
    inverses: Array
    shares: Array
    coupled: Array
    bent: Array
    changes: Array
    bodies: Array
    aside: Array
    forces: Array
    dents: Array
    levers: Array
    base: Array
    pull: Array
    factor: Array
    swung: Array
    turns: bool
    turned: Array
    strays: Array
    given: Array

    @classmethod
    def none(cls, k: int, modes: int = 0) -> InSeries:
        """Where there is no grab, or no compliance."""
        shapes = (0, k), (0,), (0, 0), (0,), (0, 3, 3, k), (0, 0, 3, 3), (0, 3, 3, 3), (0, 3, 3)
        return cls._make([*map(np.zeros, shapes), True, *_written(0, k, modes, False)])

    @classmethod
    def of(cls, space: Space, grabs: Sequence[Grab], gravity: Array | None) -> InSeries:
        """Those of a condensed space under some gravity, the scene's where it is left out."""
        compliance = space.compliance
        assert compliance is not None
        U, held = space.reduced_basis.fields, [grab.vertices for grab in grabs]
        arms = [compliance.arms(vertices) for vertices in held]
        near = [np.flatnonzero(each.any(axis=1)) for each in arms]
        gradient = [np.einsum("vik,vj->ijk", U[some], each[some]) for some, each in zip(near, arms, strict=True)]
        laws = [compliance.dent(vertices) for vertices in held]
        coupling, second, root = (np.stack([law[i] for law in laws]) for i in (1, 2, 3))
        return cls(
            np.concatenate([U[vertices].mean(axis=0) for vertices in held]),
            centres(space, grabs, gravity),
            compliance.between(held),
            np.repeat([1 / grab.stiffness for grab in grabs], 3),
            np.stack(gradient),
            coupling,
            second,
            root,
            not (coupling.any() or second.any()),
            *_written(len(held), U.shape[2], len(space.squares), space.turns),
        )


def centres(space: Space, grabs: Sequence[Grab], gravity: Array | None) -> Array:
    """Where the centroids of what grabs hold are at q = 0, sunk under some gravity, (3g,) metres."""
    assert space.compliance is not None
    sunk = space.scene.mesh.vertices + space.compliance.sag(gravity)
    return np.concatenate([sunk[grab.vertices].mean(axis=0) for grab in grabs])


def _written(count: int, k: int, modes: int, turns: bool) -> list[Any]:
    """Room for the target and for all that `warp_springs` writes, of some grabs; and whether modes turn, among it."""
    n = 3 * count
    matrices = [(count, 3, 3)] * 3
    shapes = (n,), *matrices[:2], (count,), *matrices, (count, 3), (n,), (n,), (n,), (n, k), (n,), (n, n), (n, n)
    own = (n, modes), (modes,), (modes,)
    return [*map(np.zeros, (*shapes, (modes,))), turns, *map(np.zeros, own)]
