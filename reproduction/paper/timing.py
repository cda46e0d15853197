"""Table 1 and Figures 12 and 13: latent against linear steps, as the stages of the pipeline time them."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

import numpy as np
from matplotlib.figure import Figure

from ldsim.report.paper import paper_row
from ldsim.report.svg import PALETTE, legend, new_axes, to_svg
from ldsim.run import Run
from reproduction.harness import Harness
from reproduction.paper.evaluation import parts_of_evaluation
from reproduction.paper.experiment import Outcome, Relation
from reproduction.paper.scenes import Configuration, armadillo, bar, cross, dragon, elephant
from reproduction.paper.stills import farthest_frame, still
from reproduction.reduced_runs import a_step, online_error


@dataclass(frozen=True)
class Side:
    """One reduced space of a run on its training motion."""

    dimension: int
    points: int
    step_ms: float
    evaluations: float
    evaluation_us: float
    online_error: float


@dataclass(frozen=True)
class Row:
    """A row of Table 1."""

    cells: int
    k: int
    train_s: float
    pca_s: float
    cubature_s: float
    linear: Side
    latent: Side


def sides(bench: Harness, configuration: Configuration) -> dict[str, Side]:
    """Space → what its run of the first training motion took, the whole pipeline made where it is not."""
    found = {}
    with Run.open(bench.made(configuration, "simulate")) as run:
        motion = run.snapshots.with_role("train")[0]
        for space, dimension in (("linear", run.model.kp), ("latent", run.model.decoder.r)):
            played = run.simulation[space][motion]
            found[space] = Side(
                dimension,
                len(run.cubature[space].stepped().points),
                1e3 * float(np.nanmedian(played.seconds)),
                a_step(played.evaluations, played),
                1e6 * float(np.nanmedian(played.seconds / np.maximum(played.evaluations, 1))),
                online_error(played),
            )
    return found


def table_row(bench: Harness, configuration: Configuration) -> Row:
    """What Table 1 says of a model, the whole pipeline made where it is not."""
    both = sides(bench, configuration)
    with Run.open(bench.made(configuration, "simulate")) as run:
        seconds = {kind: float(run.header(kind).notes["seconds"]) for kind in ("model", "basis", "cubature")}
        return Row(
            run.scene.mesh.n_cells,
            run.model.decoder.k,
            seconds["model"],
            seconds["basis"],
            seconds["cubature"],
            both["linear"],
            both["latent"],
        )


def table_one(bench: Harness) -> Outcome:
    """Table 1: cells, seconds of the stages, points, dimensions and step times of its five models."""
    models = {"beam": bar, "x": cross, "armadillo": armadillo, "dragon": dragon, "elephant": elephant}
    if bench.quick:  # the two procedural solids need no data
        models = {"beam": bar, "x": cross}
    rows = {name: table_row(bench, make(bench.quick)) for name, make in models.items()}
    ratios = {name: row.linear.step_ms / row.latent.step_ms for name, row in rows.items()}
    figure, ax = new_axes("", "linear step over latent step", height=3.0)
    places = np.arange(len(rows))
    ax.bar(places - 0.2, list(ratios.values()), 0.38, color=PALETTE["latent"], label="here")
    paper = [row.speedup for row in map(paper_row, rows) if row is not None]
    ax.bar(places + 0.2, paper, 0.38, color=PALETTE["linear"], alpha=0.6, label="paper")
    ax.set_xticks(places, list(rows))
    legend(ax)
    numbers = {name: asdict(row) for name, row in rows.items()}
    relations = table_relations(
        ratios, {name: (row.latent.dimension, row.linear.dimension) for name, row in rows.items()}
    )
    label = "Time of a linear step over that of a latent step, here and in the paper"
    return Outcome(to_svg(figure, label), {"rows": numbers, "ratio": ratios}, relations)


def table_relations(ratios: dict[str, float], dimensions: dict[str, tuple[int, int]]) -> tuple[Relation, ...]:
    """The relations of Table 1 from linear over latent step times, and (r, kp), of each model."""
    mean = math.exp(sum(math.log(ratio) for ratio in ratios.values()) / len(ratios))
    papers = {name: row for name in ratios if (row := paper_row(name)) is not None}
    smaller = (
        Relation(f"r over kp, {name}", r / kp, "< 1", paper=papers[name].r / papers[name].kp)
        for name, (r, kp) in dimensions.items()
    )
    faster = (
        Relation(f"linear step over latent step, {name}", ratio, ">= 1", paper=papers[name].speedup)
        for name, ratio in ratios.items()
    )
    return (*smaller, *faster, Relation("geometric mean of linear over latent step", mean, ">= 1.21", paper=1.21))


def profile(bench: Harness) -> Outcome:
    """Figure 12: what an evaluation and a step are made of, linear and latent (armadillo)."""
    found = sides(bench, armadillo(bench.quick))
    with Run.open(bench.made(armadillo(bench.quick), "simulate")) as run:
        parts = {name: parts_of_evaluation(run, name) for name in found}
        motion = run.snapshots.with_role("train")[0]
        mean = {name: 1e6 * float(np.nanmean(run.simulation[name][motion].seconds)) for name in found}
    for name, side in found.items():
        # the preconditioner is made once a step; what is left is inertia, springs, the two-loop recursion and the call
        inside = {part: us for part, us in parts[name].items() if part != "preconditioner"}
        step = side.evaluations * sum(inside.values()) + parts[name]["preconditioner"]
        parts[name]["rest of a step"] = mean[name] - step
    linear, latent = found["linear"], found["latent"]
    relations = (
        Relation(
            "evaluations a step, latent over linear", latent.evaluations / linear.evaluations, "< 1", paper=9.3 / 28
        ),
        Relation(
            "cost of an evaluation, latent over linear", latent.evaluation_us / linear.evaluation_us, ">= 1", paper=2
        ),
    )
    label = "Microseconds of a step and what they are spent on, in the linear and the latent space"
    numbers = {name: asdict(side) | {"parts_us": parts[name]} for name, side in found.items()}
    return Outcome(to_svg(_breakdown(found, parts), label), numbers, relations)


SHADES = ("linear", "second", "full", "scale-1", "latent", "scale-3", "scale-0")


def _breakdown(found: dict[str, Side], parts: dict[str, dict[str, float]]) -> Figure:
    """A bar of a step for each space, in parts."""
    figure, ax = new_axes("µs of a step, mean", "", height=2.6)
    names = [f"{name}, {side.dimension}:\n{side.evaluations:,.0f} evaluations" for name, side in found.items()]
    begin = np.zeros(len(found))
    for shade, part in zip(SHADES, parts["linear"], strict=True):
        once = part in ("preconditioner", "rest of a step")
        long = np.array([parts[name][part] * (1 if once else side.evaluations) for name, side in found.items()])
        ax.barh(range(len(found)), long, 0.55, left=begin, color=PALETTE[shade], label=part)
        begin += long
    ax.set_yticks(range(len(found)), names)
    ax.invert_yaxis()
    legend(ax)
    return figure


def armadillo_speed(bench: Harness) -> Outcome:
    """Figure 13: the armadillo with r = 20 against the linear space of equal training error."""
    found = sides(bench, armadillo(bench.quick))
    with Run.open(bench.made(armadillo(bench.quick), "simulate")) as run:
        motion = run.snapshots.with_role("train")[0]
        frame, u = farthest_frame(run, motion)
        poses = {"full": u}
        for name, side in found.items():
            coordinates = run.simulation[name][motion].coordinates
            assert coordinates is not None
            poses[f"{name}, {side.dimension}"] = run.space(name).displacement(coordinates[frame])
        shown = still(run.scene, poses)
    linear, latent = found["linear"], found["latent"]
    figure, ax = new_axes("", "median step, ms", height=3.0)
    for place, (name, side) in enumerate({"linear": linear, "latent": latent}.items()):
        ax.bar(place, side.step_ms, 0.5, color=PALETTE[name])
        text = f"{side.points} points, error {100 * side.online_error:.3g} %"
        ax.annotate(text, (place, side.step_ms), ha="center", va="bottom", fontsize=9)
    ax.set_xticks([0, 1], [f"linear, k = {linear.dimension}", f"latent, r = {latent.dimension}"])
    relations = (
        Relation("r over kp", latent.dimension / linear.dimension, "< 1", paper=20 / 62),
        Relation("linear step over latent step", linear.step_ms / latent.step_ms, ">= 1.52", paper=1.67),
        Relation("online error, latent over linear", latent.online_error / linear.online_error, "<= 1.5"),
    )
    label = "Time of a step of the armadillo in the linear and the latent space"
    return Outcome(to_svg(figure, label), {space: asdict(side) for space, side in found.items()}, relations, shown)
