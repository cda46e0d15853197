"""How few points, how well, how fast: python benchmarks/cubature.py runs/x runs/beam runs/elephant [--made runs]

For the finished runs of the pipeline (make EXPERIMENT=x …), and for armadillo and dragon, whose poses it makes itself
in `--made` (short full-space runs; the dragon's are carried over to the mesh refined once). Each part that is done is
kept in `--made`/cubature_parts and not measured again: delete the folder to start anew; interrupted, it goes on.
`--quick` measures the first run alone, with fewer poses and points.
"""

from __future__ import annotations

import json
import resource
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from cubature_models import Model, finished, made, once_refined
from numpy.typing import NDArray

from ldsim.artefacts.snapshots import Snapshots
from ldsim.dynamics.reduced_model import ReducedStepper
from ldsim.evaluation.comparison import run_reduced, with_errors
from ldsim.evaluation.machine import describe_machine
from ldsim.evaluation.plotting import GREEN, LATENT, LINEAR, new_axes, to_svg
from ldsim.reduction.cubature.fit import METHODS
from ldsim.reduction.cubature.forces import ProjectedForces
from ldsim.reduction.cubature.goal import Goal
from ldsim.reduction.cubature.ladder import CubatureSet, relative_errors
from ldsim.reduction.cubature.selection import PoseSpace, Recipe, Selection, select, split_poses
from ldsim.threads import one_thread

Row = dict[str, Any]
Array = NDArray[np.float64]

RESULTS = Path(__file__).parent / "results"
# Latent dimensions of the paper's Table 1; the armadillo's and the dragon's are in their configurations.
PAPER_R = {"x": 6, "beam": 10, "elephant": 7}
MOST = {"<= 100 points": (100, 0.05, 0.02), "<= 300 points": (300, 0.01, 0.004)}
SIZES = (5, 10, 15, 20, 30, 40, 50, 60, 80, 100, 150)
STOP = 1e-7
# Of the true poses in the target, as the configurations of x, beam and demo have it.
CLOSURE = 0.3


@dataclass(frozen=True)
class Effort:
    """How much to measure."""

    fitted: int = 400
    kept_back: int = 200
    most: tuple[str, ...] = tuple(MOST)
    methods: tuple[str, ...] = tuple(METHODS)
    method_points: int = 150
    frames: int | None = None


QUICK = Effort(100, 50, ("<= 100 points",), tuple(METHODS), 40, 60)


def row(model: str, quantity: str, value: float | None, unit: str = "", goal: str | None = None) -> Row:
    return {"model": model, "quantity": quantity, "value": value, "unit": unit, "goal": goal}


def chosen(found: Selection, most: int) -> int:
    """Index of the set with the least error on the fitted poses among those of at most so many points."""
    return max(i for i, entry in enumerate(found.fit.ladder) if len(entry.points) <= most)


def judged(space: PoseSpace, kept_back: NDArray[np.int64], sets: list[CubatureSet]) -> Array:
    """The paper's relative error: of the reduced forces by their size, on poses kept back."""
    return relative_errors(ProjectedForces(space.scene, space.U, space.decoder, space.z[kept_back]), sets)


def how_well(model: Model, effort: Effort) -> list[Row]:
    """Error on poses kept back with few points, and what the fit costs."""
    space, refined = model.space, model.name.endswith("refined")
    fitted, kept_back = split_poses(len(space.z), effort.fitted, effort.kept_back, seed=0)
    rows = [row(model.name, "cells", model.cells), row(model.name, "r", space.decoder.r)]
    for label in effort.most:
        most, error, tolerance = MOST[label]
        started = time.perf_counter()
        found = select(space, fitted, kept_back, Recipe(Goal(tolerance, most), compliance=False))
        seconds = time.perf_counter() - started
        best = found.fit.ladder[chosen(found, most)]
        heldout = float(judged(space, kept_back, [best])[0])
        limit = f"<= {300 if refined else 60}" if label == "<= 100 points" else None
        rows += [
            row(model.name, f"held-out latent relative error, {label}", heldout, "", f"<= {error}"),
            row(model.name, f"points, {label}", len(best.points), "", label.removesuffix(" points")),
            row(model.name, f"cubature, {label}", seconds, "s", limit),
        ]
    default = select(space, fitted, kept_back, Recipe(Goal(0.045, 150)))
    rows += [
        row(model.name, "points, defaults", len(default.fit.best.points)),
        row(
            model.name,
            "held-out error in the compliance norm, defaults",
            float(default.heldout_errors[-1]),
        ),
    ]
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 2**30
    return [*rows, row(model.name, "peak memory so far", memory, "GiB", "<= 12" if refined else None)]


def methods(model: Model, effort: Effort) -> list[Row]:
    """Points against error of all methods on the same poses, in the norm that the default fits."""
    fitted, kept_back = split_poses(len(model.space.z), effort.fitted // 2, effort.kept_back, seed=0)
    rows = []
    for method in effort.methods:
        started = time.perf_counter()
        found = select(model.space, fitted, kept_back, Recipe(Goal(1e-3, effort.method_points), method))
        rows.append(row(model.name, f"{method}, {effort.method_points} points", time.perf_counter() - started, "s"))
        for size in (size for size in SIZES if size <= effort.method_points):
            error = float(found.heldout_errors[chosen(found, size)])
            rows.append(row(model.name, f"held-out error, {method}, {size} points", error))
    return rows


def online(model: Model, effort: Effort) -> list[Row]:
    """Online error of sets against that of every element, on each motion of the run."""
    space = model.space
    fitted, kept_back = split_poses(len(space.z), effort.fitted, effort.kept_back, seed=0)
    goal = Goal(0.02, 100)
    latent = select(space, fitted, kept_back, Recipe(goal))
    others = {
        "linear-space": select(space, fitted, kept_back, Recipe(goal, latent=False)),
        "force norm": select(space, fitted, kept_back, Recipe(goal, compliance=False)),
        "closure": select(space, fitted, kept_back, Recipe(goal, closure=CLOSURE)),
    }
    every = CubatureSet(np.arange(space.scene.points.n_points), space.scene.points.weights, 0.0)
    sizes = [size for size in (30, 40, 50, 70, 100) if size <= len(latent.fit.best.points)]
    rows = []
    with Snapshots(model.folder / "snapshots.h5") as snapshots:
        for motion in snapshots.names:

            def error(points: CubatureSet, motion: str = motion) -> float:
                return _online_error(model, points, snapshots, motion, effort.frames)

            whole = error(every)
            rows.append(row(model.name, f"online error, every element, {motion}", whole))
            for size in sizes:
                value = error(latent.fit.ladder[chosen(latent, size)])
                rows.append(row(model.name, f"online error, latent-aware, {size} points, {motion}", value))
                goal_row = "<= 0.01" if size == sizes[-1] else None
                rows.append(
                    row(model.name, f"added to the online error, {size} points, {motion}", value - whole, "", goal_row)
                )
                for name, found in others.items():
                    value = error(found.fit.ladder[chosen(found, size)])
                    rows.append(row(model.name, f"online error, {name}, {size} points, {motion}", value))
    return rows


def _online_error(model: Model, points: CubatureSet, snapshots: Snapshots, motion: str, frames: int | None) -> float:
    space, recorded = model.space, snapshots.recorded(motion)
    stepper = ReducedStepper(
        space.scene, space.U, space.decoder, points.points, points.weights, tolerance=STOP, current=True
    )
    count = min(frames or recorded.motion.frames, recorded.motion.frames)
    run = run_reduced(stepper, space.scene, recorded.motion, recorded.held, range(count))
    run = with_errors(run, space.U, snapshots.reader(motion), run)
    assert run.mean_error is not None and run.mean_displacement is not None
    return float(run.mean_error.sum() / run.mean_displacement.sum())


def growth(rows: list[Row]) -> list[Row]:
    """The exponent of the time over the cells, fitted over all models."""
    values = {(r["model"], r["quantity"]): r["value"] for r in rows}
    pairs = [
        (values[model, "cells"], seconds)
        for (model, quantity), seconds in values.items()
        if quantity == "cubature, <= 100 points"
    ]
    if len(pairs) < 2:
        return []
    cells, seconds = np.log(np.array(pairs)).T
    return [row("all", "exponent of time over cells", float(np.polyfit(cells, seconds, 1)[0]))]


def picture(rows: list[Row]) -> str:
    """Points against held-out error, one line a method."""
    figure, ax = new_axes("cubature points", "relative error on held-out poses")
    colours = dict(zip(METHODS, (LATENT, LINEAR, GREEN, "#b06fa8", "#7a828c"), strict=True))
    for method, colour in colours.items():
        start = f"held-out error, {method}, "
        line = [
            (int(r["quantity"].removeprefix(start).split()[0]), r["value"])
            for r in rows
            if r["quantity"].startswith(start)
        ]
        if line:
            ax.loglog(*zip(*line, strict=True), color=colour, label=method, marker="o", markersize=3)
    ax.legend(frameon=False, fontsize=8, labelcolor="#23282f")
    return to_svg(figure, "Relative error on held-out poses against the number of cubature points, by method")


def parts(runs: list[Path], kept: Path, quick: bool) -> Iterator[tuple[str, Callable[[], list[Row]]]]:
    """What there is to measure, by name; nothing is read before a part is asked for."""
    effort = QUICK if quick else Effort()
    for folder in runs[: 1 if quick else None]:
        name = folder.name
        yield f"{name}-how_well", lambda n=name, f=folder: how_well(finished(n, f, PAPER_R.get(n)), effort)
        if folder == runs[0]:
            yield f"{name}-methods", lambda n=name, f=folder: methods(finished(n, f), effort)
            yield f"{name}-online", lambda n=name, f=folder: online(finished(n, f), effort)
    if not quick:
        yield "armadillo-how_well", lambda: how_well(made("armadillo", kept), effort)
        yield "dragon-how_well", lambda: how_well(once_refined(made("dragon", kept)), effort)


def main(runs: list[Path], kept: Path, quick: bool) -> None:
    folder = kept / ("cubature_parts_quick" if quick else "cubature_parts")
    folder.mkdir(parents=True, exist_ok=True)
    rows: list[Row] = []
    for name, measure in parts(runs, kept, quick):
        path = folder / f"{name}.json"
        if not path.exists():
            with one_thread():
                found = measure()
            path.write_text(json.dumps(found, ensure_ascii=False))
        part = json.loads(path.read_text())
        print(f"## {name}\n\n| quantity | value | goal |\n|---|---|---|")
        for r in part:
            print(f"| {r['quantity']} | {r['value']:.4g} {r['unit']} | {r['goal'] or ''} |", flush=True)
        rows += part
    rows += growth(rows)
    if quick:
        return
    described = describe_machine()
    content = {
        "machine": {key: value for key, value in described.items() if key != "versions"},
        "versions": described["versions"],
        "command": "python benchmarks/cubature.py " + " ".join(f"runs/{run.name}" for run in runs),
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "rows": rows,
    }
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / "cubature.json").write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n")
    (RESULTS / "cubature.svg").write_text(picture(rows), encoding="utf-8")


if __name__ == "__main__":
    arguments = [a for a in sys.argv[1:] if a != "--quick"]
    place = Path("runs")
    if "--made" in arguments:
        at = arguments.index("--made")
        place = Path(arguments[at + 1])
        del arguments[at : at + 2]
    if not arguments:
        sys.exit("usage: python benchmarks/cubature.py runs/EXPERIMENT … [--made FOLDER] [--quick] (finished runs)")
    main([Path(argument) for argument in arguments], place, "--quick" in sys.argv)
