"""`ldsim make --error`: learn until an error is held on motions that are never learned from, or time is up.

A round makes the latent space, evaluates it on the validation motions, and extends what it learns from where it is not
good enough (a weak greedy loop over a surrogate with `evaluate` and `extend`, as pyMOR has it). What it came to is an
ordinary configuration beside the one that was given, which `ldsim make` takes in its place.
"""

from __future__ import annotations

import hashlib
import math
import os
import shutil
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from ldsim.artefacts.atomic import replacing, writing
from ldsim.artefacts.training import PARTIAL, remove_checkpoints
from ldsim.errors import SettingsError
from ldsim.pipeline.convergence import ROUNDS, Round, improved, pull_errors, read_rounds, write_rounds
from ldsim.report.overview import report_of
from ldsim.report.remedies import WIDEST
from ldsim.run import Run
from ldsim.settings.experiment import STAGES, Settings, load_settings
from ldsim.settings.make import StageFailed, Staleness, make

# Where V_eff misses poses kept back from its fit by this share of the error that is asked for, it gets more points too.
POOR = 0.5
# What is extended, in this order: a decoder that is too small misses poses that it has seen as much as others, and more
# poses do not mend that (docs/notebook/2026-11-26-coordinates.md); to relax poses of more coordinates takes longest.
WIDER, OWN_RUNS, COORDINATES = "train.hidden", "train.condensed.rounds", "train.r"
ORDER = (WIDER, OWN_RUNS, COORDINATES)
# A few pulls are judged, and many are stated: the worst of thirty is some 97th percentile, and what is stated of 95 %,
# the second worst of 93, some 98th. So rounds go on, as long as there is time, until the few hold this share of the
# error that is asked for.
MARGIN = 0.8
# Rounds of own runs and coordinates that are added at once, and the most coordinates.
MORE, FURTHER, MOST = 2, 4, 24
# More of the same is not asked for where the last turn left more than this share of the error.
HELPED = 0.9
# The last stage before a round.
BEFORE = "pca"
# What the stage train is told, so that poses that are relaxed stay for the next round.
KEEP = {"train": ["--keep"]}


class Enriched:
    """The latent space of a configuration, made by the stages, and extended by settings.

    Args:
        make: runs the stages of a configuration up to one.
        earlier: the rounds of a call before; where it was not interrupted, it ended at its best one.

    Attributes:
        least: the smallest error of a round so far; infinite where there is none.
    """

    def __init__(
        self, config: Path, runs: Path, asked: float, make: Callable[[Path, str], object], earlier: Sequence[Round]
    ) -> None:
        self._given, self._runs, self._asked, self._make = config, runs, asked, make
        self._errors = errors = [_error(each) for each in earlier]
        self._changed = next((each.changed for each in reversed(earlier) if each.changed), "")
        self._best, self.least, self._at_best = load_settings(current(config)), math.inf, True
        with self._run(self._best) as run:
            if errors and _kept(run).exists():  # a call before was interrupted, and had come so far
                self._best, self.least, self._at_best = load_settings(_kept(run, "yaml")), min(errors), False

    def evaluate(self) -> tuple[float, int]:
        """The largest error of a pull of the validation motions, once what is stale up to the model is made."""
        config = current(self._given)
        settings = load_settings(config)
        self._make(config, "train" if settings.train.kind == "condensed" else "cubature")
        with self._run(settings) as run:
            errors = pull_errors(run)
            error = float(errors.max())
            self._at_best = error < self.least
            if self._at_best:
                self._best, self.least = settings, error
                _write_settings(_kept(run, "yaml"), "# The best round so far.", settings)
                with replacing(_kept(run)) as temporary:
                    shutil.copyfile(run.path("model"), temporary)
        self._errors.append(error)
        return error, len(errors)

    def extend(self) -> str:
        """Write the configuration of the next round beside the one that was given."""
        settings = load_settings(current(self._given))
        if settings.train.kind != "condensed":
            return ""
        with self._run(settings) as run:
            train = settings.train.of_solid(run.scene.mesh.n_vertices, 3 * len(run.scene.free))
            settings = settings.replace(train=train)
            poor_fit, r = float(run.model.loss[-1, 1]) > POOR * self._asked, run.model.decoder.r
            columns = run.basis.k
        helped = self._errors[-1] < HELPED * min(self._errors[:-1], default=math.inf)
        last, _, to = self._changed.partition(" ")
        # the best round, to which a call went back, has fewer coordinates than were tried
        r = max(r, int(to)) if last == COORDINATES else r
        changed, words = extended(settings, r, columns, poor_fit, last, helped)
        if words:
            write_enriched(self._given, changed)
            self._at_best, self._changed = False, words
        return words

    def take_best(self) -> float:
        """Go back to the round that was least off, where a later one was not; returns its error.

        Where all were lost the last one stays.
        """
        with self._run(self._best) as run:
            if not self._at_best and self.least < math.inf:
                os.replace(_kept(run), run.path("model"))
                write_enriched(self._given, self._best)
            for kept in (_kept(run), _kept(run, "yaml")):
                kept.unlink(missing_ok=True)
        return self.least

    def _run(self, settings: Settings) -> Run:
        return Run(self._runs / settings.experiment, settings.experiment)


def learn(
    config: Path, runs: Path, percent: float | None, minutes: float | None, until: str, say: Callable[[str], object]
) -> dict[str, str]:
    """Learn (`enrich`), make what follows, and where fresh motions say more than was asked for, learn on for less.

    A model that learned on is judged by fresh motions of its own, for those before it have been looked at.

    Args:
        percent, minutes, say: as for `enrich`.
        until: the last stage.

    Returns:
        The stages that ran, with the reason of the last time.

    Raises:
        StageFailed, SettingsError: see `enrich` and `make`.
    """
    begun, aim, ran, before = time.monotonic(), percent, dict[str, str](), ""
    if words := passed_over(config):
        say(words)
    while True:
        left = None if minutes is None else minutes - (time.monotonic() - begun) / 60
        ran |= enrich(config, runs, aim, left, say)
        in_vain = bool(before) and before == _model_of(config, runs)
        if before and not in_vain:
            _redraw(config)
        ran |= make(current(config), runs, until, say)  # of rounds in vain the report tells too
        if percent is None or aim is None or until != STAGES[-1] or in_vain:
            return ran
        folder = runs / load_settings(current(config)).experiment
        found, rounds = report_of(folder), read_rounds(folder)
        if found is None or not rounds:
            return ran
        best, statement = min(rounds, key=_error), found.statement if found.kind == "condensed" else None
        stated = None if statement is None else statement.latent.error
        held = stated is not None and 100 * stated <= percent
        if (_error(best) <= MARGIN * percent / 100) if statement is None else held:
            remove_checkpoints(folder / PARTIAL)
            return ran
        spent = time.monotonic() - begun
        if statement is None or best.error is None or (minutes is not None and spent + best.seconds > 60 * minutes):
            return ran
        # the few pulls have to hold as much less as the many missed, and less than they do
        share = HELPED if stated is None else percent / (100 * stated)
        aim = float(f"{min(aim * share, HELPED * 100 * best.error / MARGIN):.2g}")
        before = _model_of(config, runs)
        reached = "fresh motions were lost" if stated is None else f"{100 * stated:.3g} % are stated"
        say(f"{reached}, {percent:g} % were asked: it goes on, for {MARGIN * aim:.2g} % on the pulls kept aside")


def enrich(
    config: Path, runs: Path, percent: float | None, minutes: float | None, say: Callable[[str], object]
) -> dict[str, str]:
    """Learn until a relative error is held on the validation motions; the rounds lie beside the run for its report.

    Where a call before ended above it, this one goes on from there: its rounds and what it relaxed were kept. A round
    after the first in which a stage fails is the last one: the best before it is taken.

    Args:
        percent: the error; None asks for nothing, and no round is run.
        minutes: after which no round begins; None for no limit.
        say: told of each stage that runs, and a line of each round.

    Returns:
        The stages that ran, with the reason of the last time, as `make`.

    Raises:
        StageFailed: a stage before the first round or in it ended with an error, which it has told.
        SettingsError: no motion has the role validation.
    """
    folder = runs / load_settings(config).experiment
    rounds, made = _before(config, runs)
    if not rounds and (folder / ROUNDS).exists():  # where none is, a disk that is only read refuses all the same
        with writing(folder / ROUNDS):
            (folder / ROUNDS).unlink(missing_ok=True)
    if percent is None:
        _take_up(config, runs, rounds)
        return {}
    _check_judged(load_settings(current(config)))
    begun, asked, seconds = time.monotonic(), percent / 100, math.inf if minutes is None else 60 * minutes
    few, known = MARGIN * asked, None
    ran = dict(make(current(config), runs, BEFORE, say))  # no round does this again, so what rounds take is without it
    seconds -= time.monotonic() - begun
    if made:  # the round that was least off, to which a call that ended goes back
        known = min(rounds, key=_error).seconds
        if not rounds[-1].changed and _error(rounds[-1]) == min(map(_error, rounds)):
            rounds.pop()

    def stages(file: Path, until: str) -> None:
        ran.update(make(file, runs, until, say, KEEP))

    surrogate = Enriched(config, runs, asked, stages, rounds)
    try:
        for each in improved(surrogate, few, seconds, known=known):
            rounds.append(each)
            say(each.line(len(rounds), asked, few))
            write_rounds(folder, rounds)
    except StageFailed as failed:
        if surrogate.least == math.inf:
            raise
        rounds.append(Round(error=None, pulls=rounds[-1].pulls, seconds=0.0, changed=""))
        say(f"round {len(rounds)}: {failed}; the best round before it is taken")
        write_rounds(folder, rounds)
    surrogate.take_best()
    return ran


def planned(config: Path, runs: Path, percent: float | None, minutes: float | None) -> str:
    """What `enrich` would do beside the stages that are stale, in lines; empty where it would learn nothing more."""
    over = f"{words}\n" if (words := passed_over(config)) else ""
    if percent is None:
        return over
    _check_judged(load_settings(current(config)))
    rounds, made = _before(config, runs)
    few = MARGIN * percent
    if made and 100 * min(map(_error, rounds)) <= few:
        return over
    limit = "" if minutes is None else f", none that would end after {minutes:g} minutes"
    more = "more " * bool(rounds)
    return f"{over}train: {more}rounds of learning, until {few:g} % is held on the pulls kept aside{limit}\n"


def _check_judged(settings: Settings) -> None:
    """Refuse, before anything runs, a configuration that has nothing to judge a round by."""
    if "validation" not in settings.snapshot.roles:
        raise SettingsError("no motion has the role validation, which an error that is asked for is judged by; add one")


def _take_up(config: Path, runs: Path, rounds: list[Round]) -> None:
    """Where a call before was interrupted in a round, what it had come to is made, and not the round that was cut."""
    settings = load_settings(current(config))
    with Run(runs / settings.experiment, settings.experiment) as run:
        cut = bool(rounds and rounds[-1].changed) and _kept(run).exists()
    if cut:
        Enriched(config, runs, 0.0, lambda *_: None, rounds).take_best()
        write_rounds(run.folder, [*rounds[:-1], rounds[-1].replace(changed="")])


def _before(config: Path, runs: Path) -> tuple[list[Round], bool]:
    """The rounds of calls before, and whether the latent space that they came to lies there; none of another solid."""
    rounds, settings = read_rounds(runs / load_settings(config).experiment), load_settings(current(config))
    if not rounds:
        return [], False
    with Run(runs / settings.experiment, settings.experiment) as run:
        stale = Staleness(run, settings, config.parent).stale("train")
    # one that was interrupted in a round has said what that changes, but not trained it
    interrupted = current(config) != config and set(stale) == {"train"}
    return (rounds, not stale) if not stale or interrupted else ([], False)


def _error(of: Round) -> float:
    return math.inf if of.error is None else of.error


def _kept(run: Run, suffix: str = "h5") -> Path:
    """What is kept of the best round: its model, and with the suffix "yaml" its configuration."""
    return run.folder / f"model.best.{suffix}"


def extended(settings: Settings, r: int, columns: int, poor_fit: bool, last: str, helped: bool) -> tuple[Settings, str]:
    """A condensed space that can do more, and what is different; no words where nothing is left to change.

    Args:
        r: the coordinates that it has, or the most that were tried. columns: of the basis, and so the most there are.
        poor_fit: whether V_eff misses poses that it was not fitted to.
        last: which of `ORDER` was changed last; empty where none was.
        helped: whether that made the error smaller.
    """
    first = min(ORDER.index(last) + (not helped), len(ORDER) - 1) if last in ORDER else 0
    train = settings.train
    condensed, widest = train.condensed, max(train.layers)
    for what in ORDER[first:]:
        if what == WIDER and widest < WIDEST:
            wider = {"hidden": tuple(min(2 * width, WIDEST) for width in train.layers)}
            counts = {"features": 2 * condensed.features, "points": 2 * condensed.points} if poor_fit else {}
            words = ", ".join(
                [f"{WIDER} {list(wider['hidden'])}", *(f"condensed.{name} {n}" for name, n in counts.items())]
            )
            return settings.replace(train=train.replace(**wider, condensed=condensed.replace(**counts))), words
        if what == OWN_RUNS:
            more = condensed.rounds + MORE
            return settings.replace(train=train.replace(condensed=condensed.replace(rounds=more))), f"{what} {more}"
        if what == COORDINATES and (more := min(r + FURTHER, MOST, columns)) > r:
            return settings.replace(train=train.replace(r=more)), f"{what} {more}"
    return settings, ""


def _model_of(config: Path, runs: Path) -> str:
    """The hash of the model that there is."""
    with Run(runs / (experiment := load_settings(current(config)).experiment), experiment) as run:
        return run.hash("model")


def _redraw(config: Path) -> None:
    """Have other fresh motions."""
    settings = load_settings(current(config))
    if (statement := settings.simulate.statement) is not None:
        pulls = statement.pulls.replace(seed=statement.pulls.seed + 1)
        simulate = settings.simulate.replace(statement=statement.replace(pulls=pulls))
        write_enriched(config, settings.replace(simulate=simulate))


def current(config: Path) -> Path:
    """The configuration to make: what rounds came to, as long as the one that it was made from says the same."""
    if not os.path.isfile(config):  # whoever reads it says so, as where it may not be read
        return config
    place = _enriched_of(config)
    try:
        first = place.read_bytes().partition(b"\n")[0].rstrip()
    except OSError:
        return config
    return place if first == _heading(config).encode() else config


def write_enriched(config: Path, settings: Settings) -> Path:
    """Write what a round came to beside a configuration."""
    place = _enriched_of(config)
    _write_settings(place, _heading(config), settings)
    return place


def _write_settings(place: Path, heading: str, settings: Settings) -> None:
    with replacing(place) as temporary:
        temporary.write_text(f"{heading}\n{settings.dump(defaults=False)}", encoding="utf-8")


def _enriched_of(config: Path) -> Path:
    return config.with_suffix(f".enriched{config.suffix}")


def passed_over(config: Path) -> str:
    """That what rounds came to is of what the configuration said before, if it is so; otherwise nothing."""
    place = _enriched_of(config)
    if not place.is_file() or current(config) == place:
        return ""
    return f"note: {place.name} is of what {config.name} said before it was changed, and is not used"


def _heading(config: Path) -> str:
    """Of the settings, not of the text: a comment changes nothing."""
    digest = hashlib.sha256(load_settings(config).dump(defaults=False).encode()).hexdigest()
    return f"# What `ldsim make --error` came to; used in the place of {config.name} while its settings are {digest}"
