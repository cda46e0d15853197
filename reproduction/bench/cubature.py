"""How few points, how well, how fast.

Models are those of cubature_models.py, each at the paper's r; parts those of cubature_parts.py. `--model` and `--part`
may be given several times; without them all are measured, the methods on x alone. Poses come from the finished runs in
`--runs` (make EXPERIMENT=x …), the rest is made and kept in `--made`, and so is what is done: interrupted, it goes on;
to measure anew, delete the model's files in `--made`/parts and rules. `--quick` measures the embedded demo, in minutes.
All parts that are there, of whichever call, go to reproduction/results/cubature.json.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
from pathlib import Path

import numpy as np

from ldsim.cubature.methods import METHODS
from ldsim.jit import one_thread
from ldsim.report.svg import PALETTE, new_axes, to_svg
from reproduction.bench.cubature_models import SIZES, SOURCES, model, prepared
from reproduction.bench.cubature_parts import PARTS, QUICK, Effort, Fitted
from reproduction.bench.kept import kept
from reproduction.harness import Row, called, parser, row, show, write_results

NAME = "cubature"
# The poses of the dragon are carried over from a coarser mesh, so that one is stepped.
STEPPED = [*(name for name in SOURCES if name != "dragon"), "dragon_56822"]
MODELS = {"quality": [*SOURCES], "methods": ["x"], "online": STEPPED, "scaling": [*SOURCES, *SIZES]}


def measure(name: str, part: str, runs: Path, made: Path, effort: Effort) -> list[Row]:
    """The rows of one part of one model."""
    with one_thread(), model(name, runs, made) as found:
        return PARTS[part](found, effort, Fitted(found, effort, made / "rules"))


def measured(name: str, part: str, runs: Path, made: Path, effort: Effort) -> list[Row]:
    """The same, in a process of its own, for its memory; from its file where it has been done."""

    def apart() -> list[Row]:
        prepared(name, runs, made)
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            return pool.apply(measure, (name, part, runs, made, effort))

    return kept(made / "parts" / f"{name}-{part}.json", apart)


def growth(rows: list[Row]) -> list[Row]:
    """The exponent of the time over the cells: over the sizes of the dragon, on the same motions."""
    values = {(r["model"], r["quantity"]): r["value"] for r in rows}
    quantity = "cubature, at most 100 points"
    pairs = [
        (values[name, "cells"], values[name, quantity]) for name in ("dragon", *SIZES) if (name, quantity) in values
    ]
    if len(pairs) < 2:
        return []
    cells, seconds = np.log(np.array(pairs)).T
    return [row("dragon", "exponent of time over cells", float(np.polyfit(cells, seconds, 1)[0]))]


def picture(rows: list[Row], name: str) -> str:
    """Points against held-out error of one model, one line a method."""
    figure, ax = new_axes("cubature points", f"relative error on held-out poses, {name}")
    colours = dict(
        zip(METHODS, (PALETTE["latent"], PALETTE["linear"], PALETTE["second"], "#b06fa8", "#7a828c"), strict=True)
    )
    for method, colour in colours.items():
        start = f"error, held-out poses, force, {method}, "
        line = [
            (int(r["quantity"].removeprefix(start).split()[0]), r["value"])
            for r in rows
            if r["model"] == name and r["quantity"].startswith(start)
        ]
        if line:
            ax.loglog(*zip(*line, strict=True), color=colour, label=method, marker="o", markersize=3)
    ax.legend(frameon=False, fontsize=8, labelcolor="#23282f")
    return to_svg(figure, f"Relative error on held-out poses of {name} against the number of points, by method")


def collect(made: Path) -> None:
    """Everything measured so far, as one file."""
    names = [(name, part) for name in (*SOURCES, *SIZES) for part in PARTS]
    files = [made / "parts" / f"{name}-{part}.json" for name, part in names]
    rows: list[Row] = [r for file in files if file.exists() for r in json.loads(file.read_text("utf-8"))["kept"]]
    rows += growth(rows)
    write_results(NAME, called(NAME), rows)


def arguments() -> argparse.ArgumentParser:
    found = parser(NAME, __doc__)
    found.add_argument("--model", action="append", choices=[*SOURCES, *SIZES])
    found.add_argument("--part", action="append", choices=list(PARTS))
    found.add_argument("--runs", type=Path, default=Path("runs"), help="finished runs of the pipeline")
    found.add_argument("--made", type=Path, default=Path("runs/cubature"), help="what is made and kept")
    found.add_argument("--quick", action="store_true", help="the embedded demo alone")
    return found


def main() -> None:
    given = arguments().parse_args()
    made = given.made / "quick" if given.quick else given.made
    wanted = ["demo"] if given.quick else given.model
    todo = [(name, part) for part in given.part or PARTS for name in wanted or MODELS[part]]
    if ("dragon", "online") in todo:
        arguments().error("the dragon's poses are carried over from dragon_56822; for --part online, take that")
    for i, (name, part) in enumerate(todo):
        rows = measured(name, part, given.runs, made, QUICK if given.quick else Effort())
        show(rows, f"{i + 1}/{len(todo)}: {name}, {part}")
    if not given.quick:
        collect(made)


if __name__ == "__main__":
    main()
