"""Error against step time of a finished run, the linear space swept: python benchmarks/step.py runs/x

Every linear space gets its own cubature, and besides its best set smaller ones of the same ladder; each space has the
fastest of its minimisers. All are timed in one process, one thread, and judged on every motion of the run; a motion is
stepped several times, and the least time of each of its steps counts, for other tenants of a machine only add time. The
frontier of each motion goes to docs/pictures/step_RUN_MOTION.svg. `--quick` takes three dimensions.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from results_file import write_results

from ldsim.artefacts.records import read_basis, read_cubature, read_model, read_scene
from ldsim.artefacts.snapshots import Snapshots
from ldsim.dynamics.reduced import Method
from ldsim.dynamics.reduced_model import ReducedStepper, reduced_rest_stiffness
from ldsim.evaluation.comparison import ReducedSpace, fastest, run_reduced, with_errors
from ldsim.evaluation.plotting import LATENT, LINEAR, legend, log_scale, new_axes, to_svg
from ldsim.mechanics.scene import Scene
from ldsim.reduction.cubature.fit import fit
from ldsim.reduction.cubature.forces import ProjectedForces
from ldsim.reduction.cubature.goal import Goal
from ldsim.reduction.cubature.ladder import CubatureSet
from ldsim.reduction.cubature.metric import rest_compliance
from ldsim.reduction.cubature.selection import split_poses
from ldsim.reduction.decoder import Decoder
from ldsim.reduction.encoder import Encoder
from ldsim.reduction.pca import inner_product
from ldsim.reduction.reconstruction import all_coordinates
from ldsim.threads import one_thread

DIMENSIONS = (25, 30, 35, 40, 45, 50, 60)
QUICK = (20, 30, 40)
TOLERANCE = 0.03
STOP = 1e-8
# Shares of a set's points that the smaller sets of its ladder have at most.
SMALLER = (0.4, 0.65)
REPEATS = 3
PICTURES = Path(__file__).parent.parent / "docs" / "pictures"


@dataclass(frozen=True)
class Point:
    """One space on one motion."""

    space: str
    motion: str
    dimension: int
    points: int
    minimiser: str
    median_ms: float
    p99_ms: float
    evaluations: float
    online_error: float


def measure(scene: Scene, space: ReducedSpace, snapshots: Snapshots) -> list[Point]:
    """The space on every motion, with the minimiser that is fastest on the first."""

    def make(method: Method, current: bool) -> ReducedStepper:
        return ReducedStepper(
            scene,
            space.U,
            space.decoder,
            space.cubature.points,
            space.cubature.weights,
            tolerance=STOP,
            max_iterations=200,
            method=method,
            current=current,
        )

    first = snapshots.recorded(snapshots.names[0])
    minimiser, stepper = fastest(make, scene, first.motion, first.held)
    result = []
    for name in snapshots.names:
        recorded = snapshots.recorded(name)
        frames = range(recorded.motion.frames)
        tries = [run_reduced(stepper, scene, recorded.motion, recorded.held, frames) for _ in range(REPEATS)]
        run, seconds = tries[0], np.nanmin([attempt.seconds for attempt in tries], axis=0)
        run = with_errors(run, space.U, snapshots.reader(name), run)
        assert run.mean_error is not None and run.mean_displacement is not None
        result.append(
            Point(
                space.name,
                name,
                space.decoder.r,
                len(space.cubature.points),
                minimiser,
                1e3 * float(np.nanmedian(seconds)),
                1e3 * float(np.nanpercentile(seconds, 99)),
                float(run.evaluations.mean()),
                float(run.mean_error.sum() / run.mean_displacement.sum()),
            )
        )
    return result


def smaller(ladder: tuple[CubatureSet, ...], best: CubatureSet) -> list[CubatureSet]:
    """The best set of a ladder, first, and some of fewer points."""
    found = [best]
    for share in SMALLER:
        fewer = [entry for entry in ladder if len(entry.points) <= share * len(best.points)]
        found += [max(fewer, key=lambda entry: len(entry.points))] if fewer else []
    return found


def main(folder: Path, dimensions: tuple[int, ...]) -> None:
    scene, _ = read_scene(folder / "scene.h5")
    U = read_basis(folder / "basis.h5")[0].basis.U
    model, _ = read_model(folder / "model.h5")
    cubature, _ = read_cubature(folder / "cubature.h5")
    metric = inner_product(scene.mass, "mass")
    table: list[Point] = []
    with Snapshots(folder / "snapshots.h5") as snapshots, one_thread():
        names = snapshots.with_role("train")
        q: NDArray[np.float64] = all_coordinates(lambda: snapshots.chunks(names), metric, U)
        fitted, _ = split_poses(len(q), min(400, len(q) * 2 // 3), 0, seed=0)

        stiffness = reduced_rest_stiffness(scene, U)

        def spaces() -> Iterator[ReducedSpace]:
            for points in smaller(cubature["latent"].ladder, cubature["latent"].best):
                yield ReducedSpace("latent", U, model.decoder, model.encoder, points)
            for k in sorted({*dimensions, model.kp} & set(range(U.shape[1] + 1))):
                narrow, identity = np.ascontiguousarray(U[:, :k]), Decoder.identity(k)
                compliance = rest_compliance(stiffness[:k, :k], identity, q[:, :k])
                forces = ProjectedForces(scene, narrow, identity, q[fitted, :k], metric=compliance)
                found = fit(forces, Goal(TOLERANCE, 800))
                for points in smaller(found.ladder, found.best):
                    yield ReducedSpace("linear", narrow, identity, Encoder((), ()), points)

        print("| space | motion | dimension | points | minimiser | median ms | p99 ms | evaluations | online error |")
        print("|---|---|---|---|---|---|---|---|---|")
        for space in spaces():
            for point in measure(scene, space, snapshots):
                table.append(point)
                cells = [f"{v:.3g}" if isinstance(v, float) else str(v) for v in asdict(point).values()]
                print("| " + " | ".join(cells) + " |", flush=True)
        rows = ratios(folder.name, table, model.kp)
    for row in rows:
        print(row["quantity"], row["value"], "goal", row["goal"])
    write(folder.name, table, rows)
    for motion in dict.fromkeys(point.motion for point in table):
        drawn = picture(folder.name, motion, table)
        (PICTURES / f"step_{folder.name}_{motion}.svg").write_text(drawn + "\n", encoding="utf-8")


def ratios(model: str, table: list[Point], kp: int) -> list[dict[str, object]]:
    """Linear over latent step: at kp, best sets; and the fastest linear space with an online error no larger."""
    rows: list[dict[str, object]] = []
    for motion in dict.fromkeys(point.motion for point in table):
        own = [point for point in table if point.motion == motion]
        latent = next(point for point in own if point.space == "latent")
        linear = [point for point in own if point.space == "linear"]
        equal = [p for p in linear if p.online_error <= latent.online_error]
        at_kp = next(p for p in linear if p.dimension == kp)
        fastest_equal = min(equal, key=lambda p: p.median_ms) if equal else None
        for name, other in ((f"PCA-{kp} (kp)", at_kp), ("PCA of equal online error", fastest_equal)):
            value = None if other is None else other.median_ms / latent.median_ms
            label = name if other is None or other is at_kp else f"{name}, k = {other.dimension}"
            quantity = f"linear over latent step, {motion}, {label}"
            rows.append({"model": model, "quantity": quantity, "value": value, "unit": "", "goal": ">= 5"})
    return rows


def picture(model: str, motion: str, table: list[Point]) -> str:
    """Online error against median step, every space and set measured, the frontier of each kind as a line."""
    figure, ax = new_axes("median step, ms; numbers: dimension, points", f"online error on {motion}, %", height=3.6)
    for kind, colour in (("latent", LATENT), ("linear", LINEAR)):
        own = sorted((p.median_ms, 100 * p.online_error, p) for p in table if p.space == kind and p.motion == motion)
        front = [entry for i, entry in enumerate(own) if all(entry[1] < other[1] for other in own[:i])]
        behind = [entry for entry in own if entry not in front]
        ax.plot([t for t, _, _ in behind], [e for _, e, _ in behind], "o", color=colour, markersize=3, alpha=0.4)
        ax.plot([t for t, _, _ in front], [e for _, e, _ in front], "o-", color=colour, label=kind, markersize=4)
        for t, e, point in front:
            place = (-4, -9) if kind == "latent" else (4, 3)
            side = "right" if kind == "latent" else "left"
            label = f"{point.dimension}, {point.points}"
            ax.annotate(label, (t, e), place, textcoords="offset points", fontsize=7, color=colour, ha=side)
    log_scale(ax, "y")
    legend(ax)
    return to_svg(figure, f"Online error on {motion} of {model} against the median time of a step, latent and linear")


def write(model: str, table: list[Point], rows: list[dict[str, object]]) -> None:
    for point in table:
        for quantity, value, unit in (("median step", point.median_ms, "ms"), ("online error", point.online_error, "")):
            label = f"{quantity}, {point.space} {point.dimension}, {point.points} points, {point.motion}"
            rows.append({"model": model, "quantity": label, "value": value, "unit": unit, "goal": None})
    write_results(f"step_{model}", f"python benchmarks/step.py runs/{model}", rows)


if __name__ == "__main__":
    folders = [Path(argument) for argument in sys.argv[1:] if argument != "--quick"]
    if len(folders) != 1:
        sys.exit("usage: python benchmarks/step.py runs/EXPERIMENT [--quick] (a finished run)")
    main(folders[0], QUICK if "--quick" in sys.argv else DIMENSIONS)
