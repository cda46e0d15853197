"""What a user gets who asks for an error: ten solids, each by `ldsim new` and `ldsim make --error` and nothing else.

The files are made by reproduction/bench/solid_files.py. A row tells what was derived, what rounds it took, and how far
the model is off on fresh pulls (the statement of its report) and on the test motion of its configuration. Finished runs
are not made again, and results of some solids are joined with those of the others. Results go to
reproduction/results/solids.json.
"""

from __future__ import annotations

import time
from pathlib import Path

from ldsim.pipeline.convergence import read_rounds
from ldsim.report.overview import report_of
from ldsim.report.schema import RunNumbers
from ldsim.run import Run
from ldsim.settings import load_settings
from ldsim.settings.enrich import current
from reproduction.bench.solid_files import SOLIDS, write_solid
from reproduction.harness import PIPELINE, Row, add_results, called, ldsim, parser, row, show
from reproduction.reduced_runs import layers

NAME, ASKED = "solids", 5.0
INPUTS = (*PIPELINE, "ldsim/settings", "reproduction/bench/solid_files.py")


def made(name: str, folder: Path, minutes: float) -> list[Row]:
    """The rows of one solid, made by the two commands in a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    source, config, started = write_solid(name, folder), folder / f"{name}.yaml", time.perf_counter()
    if not config.exists():
        ldsim(folder, "new", source.name)
    status = ldsim(folder, "make", config.name, "--error", f"{ASKED:g}%", "--minutes", f"{minutes:g}")
    rows = [row(name, "exit status", status, goal="== 0"), row(name, "time", time.perf_counter() - started, "s")]
    numbers = report_of(folder / "runs" / name)
    return rows if numbers is None else [*rows, *_numbers(name, config, numbers, folder)]


def _numbers(name: str, config: Path, numbers: RunNumbers, folder: Path) -> list[Row]:
    pulls = next(each.pulls for each in load_settings(config).snapshot.motions if each.pulls is not None)
    train, rounds = load_settings(current(config)).train, read_rounds(folder / "runs" / name)
    with Run.open(folder / "runs" / name) as made_of:
        widths = layers(made_of)
    rows = [
        row(name, "cells", numbers.mesh.cells),
        row(name, "r", numbers.dims.r),
        row(name, "rounds of own runs", train.condensed.rounds),
        row(name, "layers", widths),
        row(name, "reach of pulls", pulls.reach, "m"),
        row(name, "stiffness of pulls", pulls.stiffness, "N/m"),
    ]
    rows += [row(name, f"validation, round {i}", each.error, goal="<= 0.05") for i, each in enumerate(rounds, 1)]
    if numbers.statement is not None:
        found = numbers.statement.latent
        rows += [
            row(name, "fresh pulls, stated", found.error, goal="<= 0.05"),
            row(name, "fresh pulls, median", found.median),
            row(name, "fresh pulls, linear, stated", numbers.statement.linear.error),
        ]
    for run in numbers.simulate.latent:
        if run.role == "test" and run.online_error is not None:
            rows.append(row(name, f"test motion {run.motion}", run.online_error.relative))
            rows.append(row(name, "median step", run.median_step_ms, "ms"))
    return rows


def main() -> None:
    arguments = parser(NAME, __doc__)
    arguments.add_argument("solids", nargs="*", choices=[*SOLIDS, []], help="which; all where none is named")
    arguments.add_argument("--folder", type=Path, default=Path("runs") / "solids", help="where files and runs lie")
    arguments.add_argument("--minutes", type=float, default=20.0, help="after which no round is begun")
    given = arguments.parse_args()
    for name in given.solids or SOLIDS:
        rows = made(name, given.folder.resolve(), given.minutes)
        show(rows, name)
        add_results(NAME, called(NAME), rows, INPUTS)


if __name__ == "__main__":
    main()
