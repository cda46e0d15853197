"""The C library under the address and undefined-behaviour sanitizers for an hour, fed damaged models and states.

Models of every kind (of tests/runtime/problems.py) are damaged in thousands of ways by tests/runtime/fuzz.c; whatever
still loads is stepped, grabbed, saved and restored from damaged states too. Ends at the first fault, whose report names
the seed that brings it back.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import ldsim.runtime
from ldsim.errors import SolverError
from ldsim.runtime.compilers import compiler
from ldsim.runtime.model_file import model_bytes
from ldsim.space.space import Space
from reproduction.harness import called, parser, row, show, write_results
from tests.runtime import fuzz, problems

NAME = "fuzz"
ROUNDS = 2000
MODELS: dict[str, Callable[[], Space]] = {
    "linear": problems.linear,
    "latent": problems.latent,
    "latent of two materials": problems.mixed,
    "condensed": problems.condensed,
    "condensed at few anchors": lambda: problems.anchored(problems.condensed()),
    "latent with moving pins": problems.with_moving_pins,
}


def main() -> None:
    options = parser(NAME, __doc__)
    options.add_argument("--minutes", type=float, default=60.0)
    options.add_argument("--seed", type=int, default=1, help="the first; other seeds damage files in other ways")
    given = options.parse_args()
    minutes = given.minutes
    command = compiler()
    if command is None:
        raise SolverError("no C compiler was found")
    counts = {name: [0, 0] for name in MODELS}
    with tempfile.TemporaryDirectory() as folder:
        program = fuzz.built(command, Path(folder), Path(ldsim.runtime.__file__).parent)
        files = {name: Path(folder, name) for name in MODELS}
        for name, make in MODELS.items():
            files[name].write_bytes(model_bytes(make()))
        started, seed = time.monotonic(), given.seed - 1
        while time.monotonic() - started < 60 * minutes:
            seed += 1
            for name, file in files.items():
                found = fuzz.damaged(program, file, seed, ROUNDS)
                counts[name] = [before + more for before, more in zip(counts[name], found, strict=True)]
        spent = (time.monotonic() - started) / 60
    rows = [row("sanitizers", "time", spent, "min", ">= 60"), row("sanitizers", "faults", 0, "", "<= 0")]
    for name, (refused, ran) in counts.items():
        rows += [row(name, "refused", refused, "files"), row(name, "ran", ran, "files")]
    show(rows)
    write_results(NAME, called(NAME), rows)


if __name__ == "__main__":
    main()
