"""What to turn when a number is bad: each piece of advice names a setting, its new value, why, and what it costs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ldsim.arrays import Array
from ldsim.cubature.options import CubatureOptions
from ldsim.dynamics.trajectory import LARGE_ONLINE_ERROR
from ldsim.learn.options import TrainOptions
from ldsim.mechanics.materials import material_names
from ldsim.report.schema import STAGES, MotionRun, RunNumbers
from ldsim.report.wording import readable
from ldsim.run import Run

# A reconstruction, or what PCA cuts off, is bad beyond this share of what the motion moves.
POOR = 0.03
# The loss still falls when a tenth of the epochs lowers it so; it learns by heart when the validation loss is so large.
FALLING, BY_HEART = 0.95, 10.0
# An error that is stated of fresh motions is bad beyond this.
STATED = 0.05
# Layers become twice as wide, up to this, by advice and in rounds of `ldsim make --error`.
WIDEST = 128
# It has a finite energy where it is turned inside out.
FINITE = "stable_neo_hookean"
# A windowed error so much smaller says that the whole one is drift.
DRIFT = 3.0


@dataclass(frozen=True, eq=False)
class Facts:
    """What advice is drawn from: the numbers of the report, what made them, and the losses, (epochs, 2).

    Attributes:
        materials: of the solid, by name.
        time_step: s.
        synthetic: whether the latent space learned from synthetic pulls too.
        train: with what was left out.
    """

    numbers: RunNumbers
    materials: list[str]
    time_step: float
    synthetic: bool
    train: TrainOptions
    cubature: CubatureOptions
    loss: Array

    @classmethod
    def of(cls, run: Run, numbers: RunNumbers) -> Facts:
        """Those of a finished run."""
        scene, train = run.scene, TrainOptions.of_dump(run.header("model").settings)
        return cls(
            numbers,
            material_names(np.unique(scene.material).tolist()),
            scene.time_step,
            run.pca.synthetic is not None,
            train.of_solid(scene.mesh.n_vertices, 3 * len(scene.free)),
            CubatureOptions.of_dump(run.header("cubature").settings),
            run.model.loss,
        )

    def bad(self, training: bool) -> MotionRun | None:
        """The worst latent run of a training motion, or of another, if it is bad."""
        runs = [run for run in self.numbers.simulate.latent if (run.role == "train") == training]
        worst = max(runs, key=relative, default=None)
        return worst if worst is not None and relative(worst) > LARGE_ONLINE_ERROR else None

    @property
    def stated(self) -> float:
        """The error that is stated of fresh motions, infinite where they were lost; none where nothing is stated."""
        statement = self.numbers.statement
        if statement is None:
            return 0.0
        return np.inf if statement.latent.error is None else statement.latent.error

    def poor(self, method: str) -> bool:
        """Whether a space cannot hold the training poses: what it leaves is a fair share of what the motions move.

        Never of a condensed space, whose poses are told without what pulls and weight move beside its coordinates.
        """
        if self.condensed:
            return False
        found, moved = self.numbers.reconstruction.train, [displacement(run) for run in self.numbers.simulate.latent]
        error = found[method].mean_mm if found is not None and found[method] is not None else None
        least = min((each for each in moved if each is not None), default=None)
        return error is not None and least is not None and error > POOR * least

    @property
    def condensed(self) -> bool:
        """Whether poses are held by what is slaved to the coordinates, and not by the columns of PCA alone."""
        return self.train.kind == "condensed"

    @property
    def wider(self) -> str | None:
        """Layers twice as wide, as a setting; None where they are as wide as is advised."""
        widths = [max(min(2 * width, WIDEST), width) for width in self.train.layers]
        now = list(self.train.layers)
        return f"train.hidden to {widths} (now {now})" if widths != now else None

    def cost(self, first: str) -> str:
        """The time of a stage and of all that follow it, as they took."""
        stages = self.numbers.stages
        seconds = sum(stages[name].seconds or 0 for name in STAGES[STAGES.index(first) :] if name in stages)
        return f"{first} and what follows took {_duration(seconds)}"


def remedies(facts: Facts) -> list[str]:
    """The rows that apply, the most promising first; empty where no number is bad."""
    return [found for found in (row(facts) for row in ROWS) if found is not None]


def _basis_too_small(facts: Facts) -> str | None:
    if not facts.poor("pca_k"):
        return None
    k = facts.numbers.dims.k or 0
    return (
        f"The linear space itself cuts off too much of the training motions: set pca.k to {_more(k, 1.5)} "
        f"(now {k}) or more; {facts.cost('pca')}."
    )


def _network_too_small(facts: Facts) -> str | None:
    if not facts.poor("autoencoder") or facts.poor("pca_k"):
        return None
    options, r = facts.train, facts.numbers.dims.r or 0
    if _still_falling(facts.loss):
        return (
            f"The training loss is still falling: set train.epochs to {2 * options.epochs} (now {options.epochs}); "
            f"{facts.cost('train')}, and the training twice as long."
        )
    return (
        f"The latent space does not hold the training poses, and the linear space does: set train.r to {_more(r, 1.4)} "
        f"(now {r}), or wider train.hidden; {facts.cost('train')}."
    )


def _unseen(facts: Facts) -> str | None:
    """Bad on what it has not seen, and good on what it has."""
    unseen = facts.bad(training=False) is not None or facts.stated > STATED
    if not unseen or facts.bad(training=True) is not None or facts.poor("autoencoder"):
        return None
    if facts.condensed and facts.numbers.rounds:
        longest = max(each.seconds or 0.0 for each in facts.numbers.rounds)
        return (
            "The latent space is not good enough for motions that it did not learn from: call `ldsim make --error` "
            "again, for a smaller error where the pulls kept aside held it, and with `--minutes` for another round; it "
            f"goes on where it ended, and its longest round took {_duration(longest)}."
        )
    if facts.condensed:
        rounds = facts.train.condensed.rounds
        turns = [facts.wider] if facts.wider else []
        turns.append(f"train.condensed.rounds to {rounds + 2} (now {rounds})")
        return (
            "The latent space is not good enough for motions that it did not learn from: `ldsim make CONFIG --error 5%`"
            f" extends it until that holds; or set {', then '.join(turns)}; {facts.cost('train')}."
        )
    snapshot = facts.numbers.stages.get("snapshot")
    seconds = snapshot.seconds if snapshot is not None and snapshot.seconds else 0.0
    return (
        "The training motions do not show what the others do: add a motion of role train like them, with another seed, "
        f"to snapshot.motions (as many pulls again take {_duration(seconds)})"
        + ("; then set pca.synthetic, which makes many more at little cost" if not facts.synthetic else "")
        + f"; {facts.cost('pca')}."
    )


def _by_heart(facts: Facts) -> str | None:
    last = facts.loss[-1] if len(facts.loss) else np.array([np.nan, np.nan])
    if facts.train.kind != "autoencoder" or not last[1] > BY_HEART * last[0]:
        return None
    widths = [max(width // 2, 8) for width in facts.train.layers]
    return (
        f"The network learns by heart: give it more snapshots, or set train.hidden to {widths} (now "
        f"{list(facts.train.layers)}); {facts.cost('train')}."
    )


def _forces(facts: Facts) -> str | None:
    """Off on training motions whose poses it holds: what is wrong is the forces."""
    if facts.bad(training=True) is None or facts.poor("autoencoder"):
        return None
    if facts.condensed:
        condensed = facts.train.condensed
        turns = [facts.wider] if facts.wider else []
        sizes = {"points": condensed.points, "features": condensed.features}
        turns += [f"train.condensed.{name} to {2 * n} (now {n})" for name, n in sizes.items() if n]
        return f"It is off on motions that it learned from: set {' and '.join(turns)}; {facts.cost('train')}."
    return f"The forces are wrong, not the shapes: set {_more_points(facts)}; {facts.cost('cubature')}."


def _more_points(facts: Facts) -> str:
    """A closer rule of an autoencoder, as settings: virtual points, where there are some, are stepped."""
    rule, options = facts.numbers.cubature.latent, facts.cubature
    if rule is not None and rule.virtual is not None:
        return f"cubature.virtual.points to {2 * options.virtual.points} (now {options.virtual.points})"
    closer = f"cubature.tolerance to {options.tolerance / 2:.2g} (now {options.tolerance:g})"
    return f"{closer} and cubature.max_points to {2 * options.max_points}"


def _missed_cubature(facts: Facts) -> str | None:
    rule, options = facts.numbers.cubature.latent, facts.cubature
    reached = rule.relative_error.fitted if rule is not None else None
    if rule is None or rule.virtual is not None or reached is None or reached <= options.tolerance:
        return None
    return (
        f"Too few cubature points were allowed: set cubature.max_points to {2 * options.max_points} (now "
        f"{options.max_points}); {facts.cost('cubature')}."
    )


def _diverged(facts: Facts) -> str | None:
    lost = [run.motion for run in facts.numbers.simulate.latent if run.diverged]
    if not lost:
        return None
    if facts.condensed:
        rounds = facts.train.condensed.rounds
        stage, turn = "train", f"train.condensed.rounds to {rounds + 2} (now {rounds})"
    else:
        stage, turn = "cubature", _more_points(facts)
    now = ", ".join(facts.materials)
    finite = "" if now == FINITE else f"mesh.material.model to {FINITE} (now {now}), which stays finite, or "
    return (
        f"The latent run of {lost[0]} was lost: set {turn}; {facts.cost(stage)}. Or set {finite}mesh.time_step to "
        f"{facts.time_step / 2:g} (now {facts.time_step:g}); {facts.cost('mesh')}."
    )


def _drift(facts: Facts) -> str | None:
    worst = facts.bad(training=False) or facts.bad(training=True)
    windowed = worst.online_error.windowed if worst is not None and worst.online_error is not None else None
    if worst is None or worst.diverged or windowed is None or windowed * DRIFT > relative(worst):
        return None
    return (
        f"Most of the error on {worst.motion} is drift: started anew every so often it is {readable(100 * windowed)} "
        "%. Where only shapes and forces count and not the phase of a long swing, nothing need be turned."
    )


ROWS: tuple[Callable[[Facts], str | None], ...] = (
    _diverged,
    _basis_too_small,
    _network_too_small,
    _unseen,
    _forces,
    _missed_cubature,
    _by_heart,
    _drift,
)


def relative(run: MotionRun) -> float:
    """The online error of a run; none where it is not known, all where it was lost."""
    if run.diverged:
        return np.inf
    found = run.online_error.relative if run.online_error is not None else None
    return 0.0 if found is None else found


def displacement(run: MotionRun) -> float | None:
    """How far a motion moves the solid in the mean, mm."""
    error = run.online_error
    if error is None or not error.relative or error.mean_mm is None:
        return None
    return error.mean_mm / error.relative


def _still_falling(loss: Array) -> bool:
    """By the medians of the last tenth of the epochs and of the tenth before it."""
    tenth = len(loss) // 10
    if tenth < 3:
        return False
    late, before = np.nanmedian(loss[-tenth:, 1]), np.nanmedian(loss[-2 * tenth : -tenth, 1])
    return bool(late < FALLING * before)


def _more(count: int, factor: float) -> int:
    return max(count + 1, round(factor * count))


def _duration(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 90 else f"{seconds / 60:.0f} min"
