"""Whether what a condensed space has in equilibrium may swing: by how far it is off either way (space/modes.py)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.pipeline.comparison import Reference, run_reduced, with_errors
from ldsim.pipeline.progress import Progress
from ldsim.run import Run
from ldsim.space.basis import Basis
from ldsim.space.encoder import Encoder
from ldsim.space.modes import Modes, slowest_modes
from ldsim.space.pca import orthonormal_rows
from ldsim.space.relaxation import Relaxation
from ldsim.space.space import Space

# What is left of a column where modes span it but for rounding.
NOTHING = 1e-9


def better_swinging(run: Run, space: Space, relaxation: Relaxation, count: int, progress: Progress) -> Space:
    """A condensed space, or the same one with its slowest modes let swing, whichever is less off.

    The validation motions say so, or the training motions where there are none. A solid that bends far turns its modes,
    which swing as at rest: it may be better off without. Both have been fitted alike.
    """
    count = min(count, 3 * len(run.scene.free) - space.r - 2)
    if count < 1:
        return space
    other = swinging(space, slowest_modes(relaxation, count))
    role = next(role for role in ("validation", "train") if run.snapshots.with_role(role))
    without, errors = space, dict[Space, float]()
    names = run.snapshots.with_role(role)
    with progress.bar("train: swing", 2 * sum(map(run.snapshots.frames, names)), "frame") as bar:
        for each in (without, other):
            errors[each] = online_error(run, each, names, bar.update)
    best = min(errors, key=lambda each: errors[each])
    words = "swing" if best is other else "are kept from swinging"
    progress.tell(
        f"note: {count} modes beside the coordinates {words}: the {role} motions are "
        f"{100 * errors[other]:.2g} % off where they swing, {100 * errors[without]:.2g} % where not"
    )
    return best


def online_error(run: Run, space: Space, names: Sequence[str], update: Callable[[], object]) -> float:
    """Mean vertex distance over mean displacement of some motions together; infinite where one is lost."""
    off = moved = 0.0
    for name in names:
        found = run.snapshots.recorded(name)
        reference = Reference(found.motion, found.held, run.snapshots.reader(name))
        played = run_reduced(ReducedStepper(space, run.reduced_options), reference, progress=update)
        judged = with_errors(played, played, space, reference)
        if judged.diverged:
            return math.inf
        assert judged.mean_error is not None and judged.mean_displacement is not None
        off, moved = off + float(judged.mean_error.sum()), moved + float(judged.mean_displacement.sum())
    return off / moved if moved > 0 else math.inf


def swinging(space: Space, modes: Modes) -> Space:
    """A condensed space with modes as the last columns of its basis, which swing; it decodes to the same poses."""
    basis, decoder, r, count = space.reduced_basis, space.decoder, space.r, len(modes.squares)
    U, first = basis.matrix, int(np.flatnonzero(basis.matrix.any(axis=0))[r])  # between them are features, zeros
    slaved = U[:, first:]
    both = np.hstack([U[:, :r], modes.fields.reshape(len(U), count), slaved])
    rows = np.roll(orthonormal_rows(both.T, basis.metric)[r:], -count, axis=0)
    shares = Basis.of(np.ascontiguousarray(rows.T), basis.metric).project(slaved.T.reshape(-1, *basis.fields.shape[:2]))
    used = np.linalg.norm(shares, axis=0) > NOTHING
    used[-count:] = True
    k = first + int(used.sum())
    change, columns = np.zeros((decoder.k, k)), np.zeros((len(U), k))
    change[:first, :first], change[first:, first:] = np.eye(first), shares[:, used]
    columns[:, :r], columns[:, first:] = U[:, :r], rows[used].T
    maps, rule = np.zeros((len(space.rule.points), 9, k)), space.rule
    assert rule.maps is not None and not rule.maps[:, :, first:].any()
    maps[:, :, :first] = rule.maps[:, :, :first]
    networks = decoder.times(change), Encoder((np.eye(k, r),), (np.zeros(r),))
    return Space.condensed(
        space.scene, Basis.of(columns, basis.metric), networks, replace(rule, maps=maps), modes.squares
    )
