"""Whether what a condensed space has in equilibrium may swing: by how far it is off either way (space/modes.py)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.pipeline.choice_of_space import error_of
from ldsim.pipeline.comparison import Reference, run_reduced, with_errors
from ldsim.pipeline.progress import Progress
from ldsim.run import Run
from ldsim.space.basis import Basis
from ldsim.space.encoder import Encoder
from ldsim.space.modes import Modes, slowest_modes
from ldsim.space.pca import orthonormal_rows
from ldsim.space.relaxation import Relaxation
from ldsim.space.space import Space

# Squared, what is left of columns where modes span them but for rounding.
NOTHING = 1e-12
# A step is longer where modes swing, so they have to be worth it: at most this share of the error is left.
WORTH = 0.9


def better_swinging(run: Run, space: Space, relaxation: Relaxation, count: int, progress: Progress) -> Space:
    """A condensed space, or the same one with its slowest modes let swing, whichever is clearly less off.

    A solid that bends far turns its modes, which swing as at rest: it may be better off without. And what they have of
    a dent may turn with the place that is held, as of an arm that turns at its pins, or not, as of a trunk that bends
    all along. The motions of either role say so, in the geometric mean, for none of them was fitted to: a condensed
    space learns from relaxed poses.
    """
    count = min(count, 3 * len(run.scene.free) - space.r - 2)
    if count < 1:
        return space
    modes = slowest_modes(relaxation, count)
    tried = [space, *(swinging(space, modes._replace(turns=turns)) for turns in (True, False))]
    roles = {role: names for role in ("train", "validation") if (names := run.snapshots.with_role(role))}
    frames = sum(run.snapshots.frames(name) for names in roles.values() for name in names)
    with progress.bar("train: do modes swing", len(tried) * frames, "frame") as bar:
        errors = [[online_error(run, each, names, bar.update) for names in roles.values()] for each in tried]
    swung = 2 if _less(errors[2], errors[1]) else 1
    best = swung if _less(errors[swung], errors[0], WORTH) else 0
    words = "swing" if best else "are kept from swinging"
    off = ", ".join(
        f"{_words(error)} on {role} motions where they swing, {_words(kept)} where not"
        for role, kept, error in zip(roles, errors[0], errors[swung], strict=True)
    )
    how = "turns" if tried[swung].turns else "does not turn"
    progress.tell(
        f"note: {count} modes beside the coordinates {words}: {off}; what they have of a dent {how} with the place "
        "that is held"
    )
    return tried[best]


def _less(one: Sequence[float], other: Sequence[float], share: float = 1.0) -> bool:
    """Whether errors are less than a share of others, by the roles of which not both are lost."""
    pairs = [pair for pair in zip(one, other, strict=True) if min(pair) < math.inf]
    return bool(pairs) and math.prod(a for a, _ in pairs) < share ** len(pairs) * math.prod(b for _, b in pairs)


def _words(error: float) -> str:
    return f"{100 * error:.2g} % off" if error < math.inf else "lost"


def online_error(run: Run, space: Space, names: Sequence[str], update: Callable[[], object]) -> float:
    """Mean vertex distance over mean displacement of some motions; infinite where one is lost or none moves."""
    played = []
    for name in names:
        found = run.snapshots.recorded(name)
        reference = Reference(found.motion, found.held, run.snapshots.reader(name))
        trajectory = run_reduced(ReducedStepper(space, run.reduced_options), reference, progress=update)
        played.append(with_errors(trajectory, space, reference))
    error = error_of(played)
    return math.inf if error is None else error


def swinging(space: Space, modes: Modes) -> Space:
    """A condensed space with modes as the last columns of its basis, which swing; it decodes to the same poses."""
    basis, decoder, r, count = space.reduced_basis, space.decoder, space.r, len(modes.squares)
    U, first = basis.matrix, int(np.flatnonzero(basis.matrix.any(axis=0))[r])  # between them are features, zeros
    slaved = U[:, first:]
    F = orthonormal_rows(np.hstack([U[:, :r], modes.fields.reshape(len(U), count)]).T, basis.metric)[r:].T
    left = slaved - F @ (Basis.of(np.ascontiguousarray(F), basis.metric).dual.T @ slaved)
    sizes, axes = np.linalg.eigh(left.T @ Basis.of(left, basis.metric).dual)
    beside = left @ (axes / np.sqrt(np.maximum(sizes, NOTHING)))[:, sizes > NOTHING]
    rows = orthonormal_rows(np.hstack([U[:, :r], F, beside]).T, basis.metric)[r:]
    moved = Basis.of(np.ascontiguousarray(np.roll(rows, -count, axis=0).T), basis.metric)
    k = first + moved.k
    change, columns = np.zeros((decoder.k, k)), np.zeros((len(U), k))
    change[:first, :first], change[first:, first:] = np.eye(first), (moved.dual.T @ slaved).T
    columns[:, :r], columns[:, first:] = U[:, :r], moved.matrix
    maps, rule = np.zeros((len(space.rule.points), 9, k)), space.rule
    assert rule.maps is not None and not rule.maps[:, :, first:].any()
    maps[:, :, :first] = rule.maps[:, :, :first]
    networks = decoder.times(change), Encoder((np.eye(k, r),), (np.zeros(r),))
    return Space.condensed(
        space.scene, Basis.of(columns, basis.metric), networks, replace(rule, maps=maps), modes.squares, modes.turns
    )
