"""Learning until an error is held: rounds, and how far a latent space is off on what it did not learn from."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Protocol

import numpy as np

from ldsim.arrays import Array
from ldsim.artefacts.atomic import replacing
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.errors import SettingsError
from ldsim.jit import one_thread
from ldsim.mechanics.motion import Motion
from ldsim.optimise.solution import Reason
from ldsim.options import Field, Options
from ldsim.pipeline.comparison import Reference, run_reduced, with_errors
from ldsim.run import Run, latent_space
from ldsim.space.lifting import Lifting
from ldsim.space.space import Space

ROUNDS = "rounds.json"


class Round(Options):
    """One turn of the loop."""

    error: Annotated[float | None, Field(description="Largest of a pull of the validation motions; null: lost.")]
    pulls: Annotated[int, Field(description="How many there are.")]
    seconds: Annotated[float, Field(description="From the beginning of the round to its error.")]
    changed: Annotated[str, Field(description="Settings that were extended after it; empty where none were.")]

    def line(self, number: int, asked: float, few: float) -> str:
        """Of a table for the console; asked is the error, and few what so few pulls have to hold for it."""
        off = "lost" if self.error is None else f"off by up to {100 * self.error:.2g} %"
        then = f"; next: {self.changed}" if self.changed else ""
        wanted = f"so few must be below {100 * few:g} % for {100 * asked:g} % on many"
        return f"round {number}: {off} on {self.pulls} pulls kept aside ({wanted}), {self.seconds:.0f} s{then}"


class Surrogate(Protocol):
    """What is made, judged and extended."""

    def evaluate(self) -> tuple[float, int]:
        """The largest error on motions that are never learned from, and how many they are."""
        ...

    def extend(self) -> str:
        """Change what it learns from; returns what was changed, empty where nothing is left to change."""
        ...


def improved(
    surrogate: Surrogate,
    asked: float,
    seconds: float,
    clock: Callable[[], float] = time.monotonic,
    known: float | None = None,
) -> Iterator[Round]:
    """Rounds, until the error is held, time is up or nothing is left to extend.

    Args:
        asked: the relative error.
        seconds: no round is begun that would end later, if it took as long as the one before.
        known: what the first round took, where its latent space is there already; None where it is made.
    """
    begun = clock()
    while True:
        start = clock()
        error, pulls = surrogate.evaluate()
        took, known = clock() - start if known is None else known, None
        again = error > asked and clock() - begun + took <= seconds
        changed = surrogate.extend() if again else ""
        yield Round(error=error if error < math.inf else None, pulls=pulls, seconds=took, changed=changed)
        if not changed:
            return


def write_rounds(folder: Path, rounds: list[Round]) -> None:
    """Keep the table of rounds beside a run, for its report."""
    with replacing(folder / ROUNDS) as temporary:
        temporary.write_text(json.dumps([each.model_dump() for each in rounds], indent=1) + "\n", encoding="utf-8")


def read_rounds(folder: Path) -> list[Round]:
    """The rounds beside a run; none where no error was asked for."""
    try:
        return [Round(**each) for each in json.loads((folder / ROUNDS).read_text(encoding="utf-8"))]
    except (OSError, ValueError, TypeError):
        return []


def pull_errors(run: Run) -> Array:
    """The online error of the latent space on each pull of the validation motions, (p,); infinite where it was lost.

    A pull lasts until the next one starts, and begins where the full space is then, for no other answers for what is
    left of the one before. A condensed space is stepped with its own potential, an autoencoder with the rule that
    cubature chose.

    Raises:
        SettingsError: no motion has the role validation.
    """
    snapshots, errors = run.snapshots, list[Array]()
    names = snapshots.with_role("validation")
    if not names:
        raise SettingsError("no motion has the role validation, which an error that is asked for is judged by; add one")
    space = _space(run)
    with one_thread():
        for name in names:
            found = snapshots.recorded(name)
            reference = Reference(found.motion, found.held, snapshots.reader(name))
            lifted = space.with_lifting(Lifting.of(run.scene, [found.motion]))
            stepper = ReducedStepper(lifted, run.reduced_options)
            played = run_reduced(stepper, reference, restarts=starts(found.motion))
            judged = with_errors(played, lifted, reference)
            assert judged.mean_error is not None and judged.mean_displacement is not None
            distance = np.where(played.reason == Reason.INFINITE_START, np.nan, judged.mean_error)
            errors.append(by_pull(found.motion, distance, judged.mean_displacement))
    every = np.concatenate(errors)
    if not len(every):
        raise SettingsError("no pull of the validation motions moves the solid; an error is judged by pulls that do")
    return every


def starts(motion: Motion) -> list[int]:
    """Frames at which a pull starts, and the first one."""
    return sorted({drag.start for drag in motion.drags} | {0})


def by_pull(motion: Motion, distance: Array, moved: Array) -> Array:
    """Mean vertex distance over mean displacement, (p,), of frames from each start of a drag to the next.

    Args:
        distance: mean vertex distance of each frame, (N,), metres; NaN or infinite where the run was lost.
        moved: mean displacement, (N,).
    """
    cuts = starts(motion)[1:]
    pairs = zip(np.split(distance, cuts), np.split(moved, cuts), strict=True)
    errors = [float(off.sum() / path.sum()) for off, path in pairs if len(path) and path.any()]
    return np.array([math.inf if math.isnan(error) else error for error in errors])


def _space(run: Run) -> Space:
    if run.model.potential is None:
        return run.space("latent")
    return replace(latent_space(run.scene, run.basis, run.model), rule=run.model.potential)
