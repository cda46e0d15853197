"""The solids of the paper with derived settings only, beside the settings that were found for them by hand.

    python -m reproduction.bench.derived beam dragon --frontiers runs/frontier --folder runs/derived

Scene and motions are what configs/<solid>.yaml says, and it says no more; all else follows from the solid, and from
what the rounds of `ldsim make --error` then change. They are judged by the validation motions. The same role's error of
the settings by hand is the middle of the three seeds of results/frontier_<solid>.json. Scene and snapshots of that
benchmark are used again where they lie. Results go to reproduction/results/derived.json.
"""

from __future__ import annotations

import time
from pathlib import Path

from ldsim.pipeline.convergence import read_rounds
from ldsim.report.frontier import on_motions
from ldsim.report.schema import ROLES
from ldsim.run import Run
from ldsim.settings import load_settings
from ldsim.settings.enrich import current
from reproduction.harness import (
    CONFIGS,
    PIPELINE,
    Row,
    add_results,
    called,
    ldsim,
    linked,
    parser,
    row,
    rows_before,
    show,
)
from reproduction.reduced_runs import layers

NAME = "derived"
SOLIDS = ("x", "beam", "elephant", "armadillo", "dragon")
SHARED = ("scene", "snapshots", "tests")
INPUTS = (*PIPELINE, "ldsim/settings")
KINDS = {"derived": "latent", "derived, its linear space": "linear"}


def written(solid: str, folder: Path) -> Path:
    """The configuration in a folder, beside which `ldsim make --error` writes what it came to."""
    place, text = folder / f"{solid}.yaml", (CONFIGS / f"{solid}.yaml").read_text(encoding="utf-8")
    if not place.exists() or place.read_text(encoding="utf-8") != text:
        place.write_text(text, encoding="utf-8")
    return place


def made(solid: str, folder: Path, frontiers: Path, asked: float, minutes: float) -> list[Row]:
    """The rows of one solid; asked is the error, per cent."""
    folder.mkdir(parents=True, exist_ok=True)
    config, started = written(solid, folder), time.perf_counter()
    if (frontiers / solid).is_dir():
        linked(frontiers / solid, folder / "runs" / solid, SHARED)
    status = ldsim(folder, "make", config.name, "--error", f"{asked:g}%", "--minutes", f"{minutes:g}")
    train, rounds = load_settings(current(config)).train, read_rounds(folder / "runs" / solid)
    rows = [
        row(solid, "error that was asked for", asked / 100),
        row(solid, "exit status", status),
        row(solid, "time", time.perf_counter() - started, "s"),
        row(solid, "rounds of own runs", train.condensed.rounds),
        *(
            row(solid, f"worst pull of the validation motions, round {i}", each.error)
            for i, each in enumerate(rounds, 1)
        ),
    ]
    with Run.open(folder / "runs" / solid) as run:
        rows += [row(solid, "r", run.model.decoder.r), row(solid, "layers", layers(run))]
        for role in ROLES:
            rows += judged(solid, role, run)
    return rows


def judged(solid: str, role: str, run: Run) -> list[Row]:
    """Errors and steps of a role's motions, and those of the settings by hand.

    Of those motions together that both were judged by, and of each where a role has several.
    """
    before = {each["quantity"]: each["value"] for each in rows_before(f"frontier_{solid}", solid)}
    names = [name for name in run.simulation["latent"] if run.motions[name].role == role]
    known = [name for name in names if f"error, {name} ({role}), condensed, middle" in before] or names
    sets = {role: known, **({f"{name} ({role})": [name] for name in names} if len(names) > 1 else {})}
    rows = []
    for motions, some in sets.items():
        standings = {each.space: each for each in on_motions(run, some)}
        for name, space in KINDS.items():
            if space in standings:
                rows.append(row(solid, f"error, {motions}, {name}", standings[space].error))
                rows.append(row(solid, f"step, {motions}, {name}", 1e6 * standings[space].seconds, "µs"))
        for what, unit in {"error": "", "step": "µs"}.items():
            for which in ("least", "middle", "largest"):
                label = f"{what}, {motions}, condensed, {which}"
                if label in before:
                    rows.append(row(solid, f"{what}, {motions}, by hand, {which}", before[label], unit))
    return rows


def main() -> None:
    arguments = parser(NAME, __doc__)
    arguments.add_argument("solids", nargs="+", choices=SOLIDS, help="which")
    arguments.add_argument("--folder", type=Path, default=Path("runs") / NAME, help="where files and runs lie")
    arguments.add_argument("--frontiers", type=Path, default=Path("runs") / "frontier", help="where those runs lie")
    arguments.add_argument("--error", type=float, default=5.0, help="per cent, what is asked for")
    arguments.add_argument("--minutes", type=float, default=20.0, help="after which no round is begun")
    given = arguments.parse_args()
    for solid in given.solids:
        rows = made(solid, given.folder.resolve(), given.frontiers.resolve(), given.error, given.minutes)
        show(rows, solid)
        add_results(NAME, called(NAME), rows, INPUTS)


if __name__ == "__main__":
    main()
