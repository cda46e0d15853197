"""Error against step time of a finished run, the linear space swept: python benchmarks/step.py runs/x

Every linear space gets its own cubature and each space the fastest of its minimisers; all are timed in one process, one
thread, and judged on every motion of the run. `--quick` takes three dimensions.
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
from ldsim.mechanics.scene import Scene
from ldsim.reduction.cubature.fit import fit
from ldsim.reduction.cubature.forces import ProjectedForces
from ldsim.reduction.cubature.goal import Goal
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
        run = run_reduced(stepper, scene, recorded.motion, recorded.held, range(recorded.motion.frames))
        run = with_errors(run, space.U, snapshots.reader(name), run)
        assert run.mean_error is not None and run.mean_displacement is not None
        result.append(
            Point(
                space.name,
                name,
                space.decoder.r,
                len(space.cubature.points),
                minimiser,
                1e3 * float(np.nanmedian(run.seconds)),
                1e3 * float(np.nanpercentile(run.seconds, 99)),
                float(run.evaluations.mean()),
                float(run.mean_error.sum() / run.mean_displacement.sum()),
            )
        )
    return result


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
            yield ReducedSpace("latent", U, model.decoder, model.encoder, cubature["latent"].best)
            for k in sorted({*dimensions, model.kp} & set(range(U.shape[1] + 1))):
                narrow, identity = np.ascontiguousarray(U[:, :k]), Decoder.identity(k)
                compliance = rest_compliance(stiffness[:k, :k], identity, q[:, :k])
                forces = ProjectedForces(scene, narrow, identity, q[fitted, :k], metric=compliance)
                points = fit(forces, Goal(TOLERANCE, 800)).best
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


def ratios(model: str, table: list[Point], kp: int) -> list[dict[str, object]]:
    """Linear over latent step: at kp, and at the smallest swept dimension with an online error no larger."""
    rows: list[dict[str, object]] = []
    for latent in (point for point in table if point.space == "latent"):
        linear = [p for p in table if p.space == "linear" and p.motion == latent.motion]
        at_kp = next(p for p in linear if p.dimension == kp)
        equal = next((p for p in linear if p.online_error <= latent.online_error), None)
        for name, other in ((f"PCA-{kp} (kp)", at_kp), ("PCA of equal online error", equal)):
            value = None if other is None else other.median_ms / latent.median_ms
            label = name if other is None or other is at_kp else f"{name}, k = {other.dimension}"
            quantity = f"linear over latent step, {latent.motion}, {label}"
            rows.append({"model": model, "quantity": quantity, "value": value, "unit": "", "goal": ">= 5"})
    return rows


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
