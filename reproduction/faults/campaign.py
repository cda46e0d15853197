"""Tries to break the program: spoilt artefacts, configurations, meshes and recordings, kills, violent loads, the page.

Outcomes: refused (one line, exit status 1), accepted (exit status 0), silent (accepted where it had to be refused, or
another result), traceback, crash, hang, outside (a change outside the campaign's folder). The last five are faults;
their messages are printed, and what found one is kept in the folder `found`.

Every trial has a seed of its own, made of the campaign's, the attack and its number. With `--keep`, a campaign goes on
where it was interrupted, several may work on different attacks at once, and signals may stop and continue any of them.
"""

from __future__ import annotations

import json
import math
import tempfile
import time
import zlib
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from ldsim.artefacts.atomic import replacing
from ldsim.jit import one_thread
from ldsim.settings import STAGES
from ldsim.simulator import load
from reproduction.bench.soak import soak
from reproduction.faults import page
from reproduction.faults.alone import FAULTS, invoke
from reproduction.faults.artefacts import FORMATS, Found, artefacts, checkpoints
from reproduction.faults.bench import EXPERIMENTS, Bench
from reproduction.faults.kills import kills
from reproduction.faults.texts import configurations, files
from reproduction.harness import Row, called, checked_out, parser, row, show, write_results

FOLDER, NAME = "faults", "campaign"
# Steps of a trial of violent loads, and the most seconds of one in the full space.
STEPS, SECONDS = 1000, 0.005
# Where README.md has the table.
README, BEGIN, END = Path(__file__).parent / "README.md", "<!-- results -->", "<!-- end of results -->"


def steps(run: str, space: str, bench: Bench, rng: np.random.Generator) -> Found:
    """A thousand steps under violent loads."""

    def trial() -> str:
        simulator = load(bench.whole / run, space, seconds=SECONDS)
        soak(simulator, rng, STEPS)
        return json.dumps({outcome.name.lower(): count for outcome, count in simulator.counts.items()})

    (said,) = bench.alone(trial)
    counts = json.loads(said) if said.startswith("{") else {said: 1}
    for kind, count in counts.items():
        for _ in range(count):
            yield f"steps in the {'condensed' if run == 'condensed' else space} space", kind, space


class Attack(NamedTuple):
    """What is tried, how often, and for how many seconds at least."""

    trial: Callable[[Bench, np.random.Generator], Found]
    trials: int
    seconds: float = 0.0


ATTACKS = {
    "artefacts": Attack(artefacts, 5200),
    "checkpoints": Attack(checkpoints, 100),
    "configurations": Attack(configurations, 2500),
    "files": Attack(files, 1500),
    "kills": Attack(kills, 220),
    "latent": Attack(partial(steps, "small", "latent"), 100),
    "linear": Attack(partial(steps, "small", "linear"), 100),
    "condensed": Attack(partial(steps, "condensed", "latent"), 100),
    "full": Attack(partial(steps, "small", "full"), 100),
    "page": Attack(page.page, 0, 3600.0),
}

COLD = {"configurations", "files"}  # of nothing compiled


class Progress:
    """What an attack of a seed has come to so far, in a file of its own."""

    def __init__(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        self.path = path
        kept = json.loads(self.path.read_text(encoding="utf-8")) if self.path.exists() else {}
        self.done, self.seconds = int(kept.get("done", 0)), float(kept.get("seconds", 0.0))
        self.counts = {name: Counter(found) for name, found in kept.get("counts", {}).items()}
        self.found: list[str] = kept.get("found", [])
        self.commits = Counter(kept.get("commits", {}))

    def add(self, found: Found) -> None:
        """Count one trial, and print what it found."""
        started = time.monotonic()
        for name, said, what in found:
            kind = said.split(":")[0]
            self.counts.setdefault(name, Counter())[kind] += 1
            if kind in FAULTS:
                self.found.append(f"{name}, trial {self.done}, {what}: {said}")
                tqdm.write(self.found[-1])
        self.done, self.seconds = self.done + 1, self.seconds + time.monotonic() - started

    def save(self) -> None:
        with replacing(self.path) as path:
            path.write_text(json.dumps(vars(self) | {"path": self.path.name}), encoding="utf-8")


def run_attack(bench: Bench, attack: str, given: Attack, seed: int) -> None:
    """All trials of an attack that were not done yet."""
    progress, commit = Progress(bench.folder / "progress" / f"{attack}-{seed}.json"), checked_out() or "none"
    with tqdm(total=given.trials or None, initial=progress.done, desc=attack, mininterval=30) as bar:
        while progress.done < given.trials or progress.seconds < given.seconds:
            rng = np.random.default_rng((seed, zlib.crc32(attack.encode()), progress.done))
            progress.add(given.trial(bench, rng))
            progress.commits[commit] += 1
            progress.save()
            bar.update()


def rows(folder: Path) -> list[Row]:
    """What all attacks came to, of all seeds together."""
    found = []
    for attack in ATTACKS:
        done = [Progress(path) for path in sorted(folder.glob(f"{attack}-*.json"))]
        for name in dict.fromkeys(name for each in done for name in each.counts):
            counts = sum((each.counts.get(name, Counter()) for each in done), Counter[str]())
            found.append(row("small and condensed", f"{name}, tried", counts.total()))
            others = sorted(set(counts) - set(FAULTS))
            found += [row("small and condensed", f"{name}, {kind}", counts[kind]) for kind in others]
            found += [row("small and condensed", f"{name}, {kind}", counts[kind], goal="0") for kind in FAULTS]
        for commit, trials in sum((each.commits for each in done), Counter[str]()).items():
            found.append(row("small and condensed", f"{attack}, trials of commit {commit}", trials))
        if done:
            found.append(row("small and condensed", f"{attack}, time", round(sum(each.seconds for each in done)), "s"))
    return found


def table(found: list[Row]) -> str:
    """The rows as the table of README.md: what was tried, how often, and what came of it; faults in a column."""
    counts: dict[str, dict[str, int]] = {}
    for each in found:
        name, _, kind = each["quantity"].rpartition(", ")
        if each["unit"] == "" and not kind.startswith("trials of"):
            counts.setdefault(name, {})[kind] = each["value"]
    lines = ["| | tried | came to | faults |", "|---|---|---|---|"]
    for name, its in counts.items():
        rest = ", ".join(f"{kind} {n:,}" for kind, n in its.items() if kind != "tried" and kind not in FAULTS)
        faults = ", ".join(f"{kind} {its[kind]}" for kind in FAULTS if its.get(kind)) or "0"
        lines.append(f"| {name} | {its['tried']:,} | {rest} | {faults} |")
    return "\n".join(lines)


def fill(text: str, found: list[Row]) -> str:
    """The text of README.md with the table of these rows."""
    head, _, rest = text.partition(BEGIN)
    return f"{head}{BEGIN}\n{table(found)}\n{END}{rest.partition(END)[2]}"


def warm(bench: Bench) -> None:
    """Import, compile and read once here what the trials' processes then have from the start."""
    for name in EXPERIMENTS:
        bench.copy(name)
        for stage in (*STAGES[1:], STAGES[0]):  # a new scene first would mean new snapshots
            bench.command(stage, name, bench.made)
        for form in FORMATS:
            invoke("export", bench.made / name, "--format", form, "--output", bench.made / "exported")
        invoke("info", bench.made / name)


def main() -> None:
    arguments = parser(NAME, __doc__, FOLDER)
    arguments.add_argument("--attacks", nargs="+", choices=ATTACKS, default=list(ATTACKS))
    arguments.add_argument("--trials", type=int, help="of each attack; left out, those of a full campaign")
    arguments.add_argument("--seconds", type=float, help="of the attack on the page, left out an hour")
    arguments.add_argument("--seed", type=int, default=0)
    arguments.add_argument("--keep", type=Path, help="folder for the runs, the progress and what found something")
    arguments.add_argument("--quick", action="store_true", help="write no results")
    given = arguments.parse_args()
    folder = (given.keep or Path(tempfile.mkdtemp())).resolve()
    try:
        with one_thread():
            bench = Bench(folder)
            if set(given.attacks) - COLD:
                warm(bench)
            for attack in given.attacks:
                full = ATTACKS[attack]
                trials = full.trials if given.trials is None or not full.trials else given.trials
                seconds = min(full.seconds, math.inf if given.seconds is None else given.seconds)
                run_attack(bench, attack, full._replace(trials=trials, seconds=seconds), given.seed)
                show(rows(folder / "progress"), attack)
    finally:
        page.end()
        if not given.quick:
            found = rows(folder / "progress")
            write_results("faults", called(NAME, FOLDER), found)
            README.write_text(fill(README.read_text(encoding="utf-8"), found), encoding="utf-8")


if __name__ == "__main__":
    main()
