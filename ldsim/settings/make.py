"""What of a run is missing or stale, and the stages that make it: what `ldsim make` does, and the Makefile by it."""

from __future__ import annotations

import contextlib
import json
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from pathlib import Path
from types import MappingProxyType

import yaml

from ldsim.artefacts.store import WRITTEN_BY, file_hash, read_header, reading
from ldsim.dynamics.reduced import advance
from ldsim.errors import INTERRUPTED, StageInterrupted
from ldsim.jit import are_kept
from ldsim.options import Options
from ldsim.pipeline.convergence import read_rounds
from ldsim.pipeline.files import file_sums
from ldsim.report.overview import NUMBERS, PAGE, report_of
from ldsim.run import Run
from ldsim.settings.experiment import STAGES, Settings, load_settings

# What each stage writes; the report is no artefact.
KINDS_OF = {
    stage: tuple(kind for kind, writer in WRITTEN_BY.items() if writer == stage) or (stage,) for stage in STAGES
}
# What each is for, to whoever waits for it.
MAKES = {
    "mesh": "the mesh and its scene",
    "snapshot": "motions of the full space to learn from",
    "pca": "the linear basis",
    "train": "the latent space",
    "cubature": "cubature points",
    "simulate": "how far the reduced spaces are off",
    "report": "the report",
}
# Motions of the role test, and who reads them.
TESTS, JUDGES = "tests", ("simulate", "report")
# Stages without a reduced step, which is compiled beside them, once on a machine.
WITHOUT_STEPS = ("mesh", "snapshot")
AHEAD = "ldsim.dynamics.reduced.ahead"
# Status of a stage whose artefact is whole but misses a tolerance, which is told; no reason to stop.
MISSED = 3
# Statuses of a stage that was interrupted and has told it. CPython has the signal too, where it came within an exec().
BY_CTRL_C = (INTERRUPTED, -signal.SIGINT)
# How long a stage may take to end by itself once it was interrupted.
TO_END_S = 10.0
# A note of a header: the files outside the run that it was made from.
FILES = "files"
# Settings that change how long a stage takes, and not what it writes.
WITHOUT_EFFECT = ("threads",)
LACKS_MEMORY = (
    ", as the system ends what takes too much memory; what was finished is kept — use a coarser mesh, fewer "
    "snapshot.workers or a machine with more memory"
)


class Staleness:
    """Judges the artefacts of a run by what they say they were made from, each once.

    Args:
        base: the folder of the configuration.
    """

    def __init__(self, run: Run, settings: Settings, base: Path) -> None:
        self._run, self._settings, self._base = run, settings, base
        self._hashes: dict[str, str] = {}

    def stale(self, until: str = STAGES[-1]) -> dict[str, str]:
        """The stages up to one that have to run, each with the reason.

        Raises:
            ArtefactError: an artefact is damaged or of another version of ldsim.
            SettingsError: a file that the configuration names is not there.
        """
        found: dict[str, str] = {}
        kinds: set[str] = set()
        for stage in up_to(until):
            reasons = self.reasons(stage, kinds)
            if reasons:
                found[stage] = next(iter(reasons.values()))
                kinds |= set(reasons)
        return found

    def told(self, until: str) -> str:
        """The stages up to one that have to run, a line each."""
        return "".join(f"{stage}: {reason}\n" for stage, reason in self.stale(until).items())

    def reasons(self, stage: str, stale: Set[str] = frozenset()) -> dict[str, str]:
        """Why a stage has to run, by kind of what it writes; empty where it has not.

        Args:
            stale: kinds of artefacts before it that will be made anew.
        """
        found = {}
        for kind in KINDS_OF[stage]:
            report = stage == STAGES[-1]
            reason = self._of_report(stale) if report else self._of_artefact(kind, stage, stale)
            if reason is not None:
                found[kind] = reason
        return found

    def written(self, stage: str) -> None:
        """Forget what was known of the artefacts of a stage that has run."""
        for kind in KINDS_OF[stage]:
            self._hashes.pop(kind, None)

    def _of_artefact(self, kind: str, stage: str, stale: Set[str]) -> str | None:
        path, section = self._run.path(kind), self._section(kind, stage)
        if not path.is_file():
            wanted = kind != TESTS or self._settings.snapshot.tests.motions
            return f"{path.name} is not there yet" if wanted else None
        with reading(path, kind) as file:
            header = read_header(file)
        if header.notes.get("experiment") != self._settings.experiment:
            return f"{path.name} belongs to the experiment {header.notes.get('experiment')}"
        now = file_sums(getattr(section, "input_files", ()), self._base)
        if header.notes.get(FILES, now) != now:  # artefacts of earlier versions do not say
            return f"{', '.join(_changed_files(str(header.notes[FILES]), now))} changed"
        return self._of_settings(header.settings, section) or self._of_inputs(stage, header.inputs, stale)

    def _section(self, kind: str, stage: str) -> Options:
        """The settings that the header of an artefact has."""
        snapshot = self._settings.snapshot
        return {"snapshots": snapshot.learned, TESTS: snapshot.tests}.get(kind) or self._settings.section(stage)

    def _of_report(self, stale: Set[str]) -> str | None:
        folder = self._run.folder
        found = report_of(folder)
        if found is None:
            return f"{NUMBERS} is missing, or of an earlier version"
        if not (folder / PAGE).is_file():
            return f"{PAGE} is missing"
        if [each.model_dump() for each in found.rounds] != [each.model_dump() for each in read_rounds(folder)]:
            return "there were more rounds of learning"
        made = found.made_from
        same = self._of_settings(made.settings, self._settings.report)
        return same or self._of_inputs(STAGES[-1], made.inputs, stale)

    def _of_settings(self, before: str, section: Options) -> str | None:
        if before == section.dump():
            return None
        changed = [name for name in changed_settings(before, section) if name not in WITHOUT_EFFECT]
        return f"{', '.join(changed)} changed" if changed else None

    def _of_inputs(self, stage: str, inputs: Mapping[str, str], stale: Set[str]) -> str | None:
        before = [kind for kind in inputs if kind in stale]
        if before:
            return f"{WRITTEN_BY[before[0]]} comes before it"
        if stage in JUDGES and TESTS not in inputs and (TESTS in stale or self._run.path(TESTS).is_file()):
            return f"it has not seen {TESTS}.h5"
        other = [kind for kind, digest in inputs.items() if self._hash(kind) != digest]
        return f"it was made from another {other[0]}.h5" if other else None

    def _hash(self, kind: str) -> str:
        if kind not in self._hashes:
            path = self._run.path(kind)
            self._hashes[kind] = file_hash(path) if path.is_file() else ""
        return self._hashes[kind]


def make(
    config: Path,
    runs: Path,
    until: str,
    say: Callable[[str], object],
    flags: Mapping[str, Sequence[str]] = MappingProxyType({}),
) -> dict[str, str]:
    """Run what is missing or stale, up to a stage, each in a process of its own, so that its memory and times are its.

    Args:
        say: told of each stage that runs, and why.
        flags: further arguments of some stages.

    Returns:
        The stages that ran, with the reason.

    Raises:
        StageFailed: a stage ended with an error, which it has told; what is finished is kept.
        StageInterrupted: Ctrl+C ended a stage.
    """
    settings = load_settings(config)
    ran: dict[str, str] = {}
    with Run(runs / settings.experiment, settings.experiment) as run, compiled_ahead(say) as ahead, ended_alike():
        known = Staleness(run, settings, config.parent)
        for stage in up_to(until):
            reasons = known.reasons(stage)  # all that comes before it is as it should be by now
            if not reasons:
                continue
            ahead(stage)
            reason = next(iter(reasons.values()))
            say(f"{stage}: stage {STAGES.index(stage) + 1} of {len(STAGES)}, {MAKES[stage]} ({reason})")
            command = [sys.executable, "-m", "ldsim", stage, str(config), "--runs", str(runs), *flags.get(stage, ())]
            status = status_of(command)
            if status in BY_CTRL_C:
                raise StageInterrupted
            if status not in (0, MISSED):
                failed = StageFailed(stage, status)
                if status < 0:
                    say(str(failed))
                raise failed
            known.written(stage)
            ran[stage] = reason
    return ran


def status_of(command: Sequence[str]) -> int:
    """The exit status of a stage, which ends where this process is to end.

    Ctrl+C reaches both: a stage has some seconds to tell of it, so that this process need not.
    """
    process = subprocess.Popen(command)
    try:
        return process.wait()
    except KeyboardInterrupt:
        with contextlib.suppress(subprocess.TimeoutExpired):
            if (status := process.wait(TO_END_S)) in BY_CTRL_C:
                return status
        raise
    finally:
        process.kill()
        process.wait()


@contextlib.contextmanager
def compiled_ahead(say: Callable[[str], object]) -> Iterator[Callable[[str], None]]:
    """Yields what is called with each stage before it runs.

    The first without a reduced step begins to compile that in a process of its own, where it is not kept from before;
    the first with one waits for it, for it would compile the same.
    """
    compiling: list[subprocess.Popen[bytes]] = []

    def before(stage: str) -> None:
        if stage not in WITHOUT_STEPS:
            for process in compiling:
                if process.poll() is None:
                    say("compiling the reduced step, once on this machine")
                process.wait()
        elif not compiling and not are_kept(Path(advance.__file__)):
            compiling.append(subprocess.Popen([sys.executable, "-m", AHEAD], stderr=subprocess.DEVNULL))

    try:
        yield before
    finally:
        for process in compiling:
            process.kill()
            process.wait()


@contextlib.contextmanager
def ended_alike() -> Iterator[None]:
    """Whoever asks this process to end, as `kill` does, ends the stage that it waits for too."""
    if threading.current_thread() is not threading.main_thread():  # no other thread can take signals
        yield
        return
    before = signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


class StageFailed(Exception):
    """A stage ended with an error that it has told itself, or by a signal, of which `make` tells."""

    def __init__(self, stage: str, status: int) -> None:
        words = f"was ended by signal {-status}" + LACKS_MEMORY * (-status == signal.SIGKILL)
        super().__init__(f"{stage} {words if status < 0 else f'ended with status {status}'}")
        self.status = status if status > 0 else 1


def up_to(stage: str) -> tuple[str, ...]:
    """The stages that end with one."""
    return STAGES[: STAGES.index(stage) + 1]


def nothing_to_do(run: Run, until: str) -> str:
    """What is said where no stage ran, for each that does tells what it wrote."""
    made = run.folder / PAGE if until == STAGES[-1] else run.path(KINDS_OF[until][0])
    return f"nothing to do, {run.experiment} is up to date: {made.resolve()}\n"


def changed_settings(before: str, now: Options) -> list[str]:
    """The dotted keys whose values differ between the YAML of an artefact and options."""
    try:
        return _differing(yaml.safe_load(before), yaml.safe_load(now.dump())) or ["settings"]
    except (yaml.YAMLError, ValueError, RecursionError):  # somebody wrote it
        return ["settings"]


def _differing(old: object, new: object, path: str = "") -> list[str]:
    if not (isinstance(old, dict) and isinstance(new, dict)):
        return [] if old == new else [path]
    names = [*old, *(name for name in new if name not in old)]
    return [key for name in names for key in _differing(old.get(name), new.get(name), f"{path}.{name}".lstrip("."))]


def _changed_files(before: str, now: str) -> list[str]:
    try:
        old, new = json.loads(before), json.loads(now)
        return [name for name in {**old, **new} if old.get(name) != new.get(name)]
    except (ValueError, TypeError, AttributeError, RecursionError):  # somebody wrote it
        return ["files"]
