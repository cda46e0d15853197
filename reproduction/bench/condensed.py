"""What a condensed latent space is worth beside linear ones, on every motion of finished runs.

The run is made with `train.kind: condensed`. Its latent space is stepped as `ldsim simulate` steps it; the linear
spaces have every element integrated, which is the best error that they can have and says nothing of their time. A row
tells how many linear dimensions a condensed coordinate is worth on a motion; where no dimension swept is as good, that
it is worth more than the largest. Results go to reproduction/results/condensed.json.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from ldsim.jit import one_thread
from ldsim.run import Run
from ldsim.space.space import Space
from reproduction.bench.space import errors, worth
from reproduction.bench.space_parts import measure_stepped
from reproduction.harness import Row, called, parser, row, show, write_results
from reproduction.reduced_runs import WINDOW, played, reference
from reproduction.rivals.every_element import EveryElement

NAME = "condensed"
DIMENSIONS = (16, 20, 40, 60, 80, 100)
# Largest online error of each solid's motions, as the project asks for it.
GOALS = {"x": "<= 0.03", "elephant": "<= 0.05", "armadillo": "<= 0.08", "dragon": "<= 0.05", "beam": "<= 0.02"}
LINEAR_WORTH = ">= 5"


def measure(run: Run, solid: str, swept: tuple[int, ...]) -> list[Row]:
    """The rows of one finished run."""
    name, model = run.experiment, run.model
    assert model.potential is not None, f"{run.folder} has no condensed space; set train.kind: condensed"
    rows = [
        row(name, "r", model.decoder.r, "", "<= 16"),
        row(name, "cells", run.scene.mesh.n_cells),
        row(name, "train stage", float(run.header("model").notes["seconds"]), "s", "<= 600"),
        row(name, "peak memory of the train stage", float(run.header("model").notes["peak_memory_mb"]), "MB"),
        row(name, "relative error of V_eff's force, median, poses kept back", model.potential.heldout_error),
        row(name, "V_eff was judged better than points of the mesh", run.cubature["latent"].virtual is not None),
    ]
    motions = list(run.snapshots.names)
    for found in measure_stepped(run, motions):
        unseen = "(heldout)" in found["quantity"] and found["quantity"].startswith("online")
        rows.append({**found, "goal": GOALS.get(solid) if unseen else None})
    for motion in motions:
        label = f"{motion} ({run.recorded(motion).role})"
        for k in (k for k in swept if k <= run.basis.k):
            space = Space.linear(run.scene, run.basis, k)
            online = played(EveryElement(space), reference(run, motion), WINDOW).relative_error
            rows.append(row(name, f"online error, {label}, linear {k}", online))
        linear = errors(rows, label, "linear")
        for r, error in errors(rows, label, "stepped").items():
            equal = worth(error, linear)
            if equal is not None:
                rows.append(row(name, f"kp/r, {label}", equal / r, "", LINEAR_WORTH))
            elif linear and np.isfinite(error) and error < min(linear.values()):
                rows.append(row(name, f"kp/r, {label}, more than", max(linear) / r, "", LINEAR_WORTH))
    show(rows, name)
    return rows


def arguments() -> argparse.ArgumentParser:
    found = parser(NAME, __doc__)
    found.add_argument("runs", nargs="+", type=Path, help="folders of finished runs")
    found.add_argument("--linear", type=int, action="append", help="only this linear dimension")
    return found


def main() -> None:
    given, rows = arguments().parse_args(), list[Row]()
    swept = tuple(given.linear or DIMENSIONS)
    with one_thread():
        for folder in given.runs:
            with Run.open(folder) as run:
                solid = run.experiment.removesuffix("_condensed")
                rows += measure(run, solid, swept)
                write_results(NAME, called(NAME), rows)


if __name__ == "__main__":
    main()
