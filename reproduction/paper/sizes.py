"""Figures 6 and 7: what the depth of the network, the latent and the outer dimension buy."""

from __future__ import annotations

from typing import Any

import numpy as np

from ldsim.jit import one_thread
from ldsim.learn.examples import Examples
from ldsim.learn.options import TrainOptions
from ldsim.learn.training import Trained, train
from ldsim.report.svg import INK, PALETTE, legend, log_scale, new_axes, to_svg
from ldsim.run import Run
from ldsim.space.space import Space
from reproduction.harness import Harness
from reproduction.paper.experiment import Outcome, Relation
from reproduction.paper.scenes import bar, cross
from reproduction.reduced_runs import largest_error, play, training_coordinates

# The paper's loss, all coordinates alike; a tenth of the frames is kept back to choose the weights.
PAPER = TrainOptions(kind="autoencoder", balance=0.0, validation_share=0.1)


def _trained(run: Run, r: int, k: int, options: TrainOptions) -> tuple[Trained, float]:
    """An autoencoder on the first k coordinates and its largest vertex error on the training snapshots, mm."""
    q = np.ascontiguousarray(training_coordinates(run)[:, :k])
    with one_thread():
        trained = train(Examples(q), r, options)
    return trained, largest_error(run, trained.decoder(trained.encoder(q)))


def depth(bench: Harness) -> Outcome:
    """Figure 6: error and step time against the number of hidden layers (X, r 6, k 19, width 200)."""
    epochs, width, repeats = (200, 60, 1) if bench.quick else (500, 200, 3)
    depths, columns = range(1, 7), 19
    with Run.open(bench.made(cross(bench.quick, columns), "cubature")) as run:
        motion, rule = run.snapshots.names[0], run.cubature["latent"].best

        def measured(layers: int, seed: int) -> dict[str, Any]:
            options = PAPER.replace(hidden=(width,) * layers, epochs=epochs, seed=seed)
            trained, error = _trained(run, 6, columns, options)
            with one_thread():
                networks = trained.decoder, trained.encoder
                space = Space.latent(run.scene, run.basis.columns(columns), networks, rule)
                played = play(run, motion, space, frames=100)
            cost = played.seconds / np.maximum(played.evaluations, 1)
            return {
                "max_mm": error,
                "step_ms": 1e3 * float(np.nanmedian(played.seconds)),
                "evaluation_us": 1e6 * float(np.nanmedian(cost)),
            }

        table = {
            layers: [
                bench.remembered(f"{layers} layers of {width}, seed {seed}", lambda: measured(layers, seed))
                for seed in range(repeats)
            ]
            for layers in depths
        }
    means = {
        key: [float(np.mean([row[key] for row in table[layers]])) for layers in depths]
        for key in ("max_mm", "step_ms", "evaluation_us")
    }
    figure, ax = new_axes("hidden layers", "largest vertex error, mm", height=3.2)
    ax.plot(depths, means["max_mm"], color=PALETTE["latent"], marker="o", label="error")
    time = ax.twinx()
    time.set_ylabel("one step, ms", color=INK, fontsize=9.5)
    time.spines[:].set_visible(False)
    time.plot(depths, means["step_ms"], color=PALETTE["linear"], marker="s")
    ax.plot([], [], color=PALETTE["linear"], marker="s", label="step time (right)")
    legend(ax)
    relations = (
        Relation(
            "cost of an evaluation, six layers over one", means["evaluation_us"][5] / means["evaluation_us"][0], "> 1"
        ),
        Relation(
            "time of a step, six layers over one", means["step_ms"][5] / means["step_ms"][0], "> 1", paper=6.44 / 3.36
        ),
        Relation("error, two layers over one", means["max_mm"][1] / means["max_mm"][0], "< 1", paper=20.2 / 31.1),
        Relation(
            "share of the best gain in error that two layers reach",
            _share_of_gain(means["max_mm"]),
            ">= 0.5",
            paper=_share_of_gain([31.1, 20.2, 20.1, 17.1, 17.1, 17.5]),
        ),
    )
    label = "Largest training error and time of a step against the number of hidden layers"
    return Outcome(to_svg(figure, label), {"layers": list(depths), **means, "runs": table}, relations)


def _share_of_gain(errors: list[float]) -> float:
    """How much of the way from one layer's error to the least one two layers go."""
    gain = errors[0] - min(errors)
    return (errors[0] - errors[1]) / gain if gain > 0 else 1.0


def latent_and_outer_size(bench: Harness) -> Outcome:
    """Figure 7: largest training error against r, for several k (beam)."""
    rs, ks = ((1, 3, 6, 10), (6, 10, 20)) if bench.quick else ((1, 3, 6, 10, 15, 20), (3, 6, 10, 15, 20, 30))
    epochs, repeats = (300, 1) if bench.quick else (500, 3)
    with Run.open(bench.made(bar(bench.quick), "pca")) as run:

        def measured(r: int, k: int, seed: int) -> dict[str, Any]:
            options = PAPER.replace(epochs=epochs, seed=seed)
            return {"max_mm": _trained(run, r, k, options)[1]}

        def mean(r: int, k: int) -> float:
            name = f"r {r}, k {k}, {epochs} epochs, seed "
            results = [bench.remembered(f"{name}{seed}", lambda: measured(r, k, seed)) for seed in range(repeats)]
            return float(np.mean([result["max_mm"] for result in results]))

        table = {k: {r: mean(r, k) for r in rs if r <= k} for k in ks}
        floor = {k: 1e3 * float(run.pca.max_error[k]) for k in ks}
    figure, ax = new_axes("latent dimension r", "largest vertex error, mm", height=3.4)
    for i, (k, row) in enumerate(table.items()):
        shade = 0.35 + 0.65 * i / max(len(table) - 1, 1)
        ax.plot(list(row), list(row.values()), color=PALETTE["latent"], alpha=shade, marker="o", label=f"k = {k}")
        ax.axhline(floor[k], color=PALETTE["linear"], alpha=shade, lw=1, ls=(0, (4, 2)))
    log_scale(ax, "y")
    legend(ax)
    label = "Largest training error against the latent dimension; dashed, the floor of PCA with k columns"
    numbers = {"autoencoder_max_mm": table, "pca_k_max_mm": floor}
    return Outcome(to_svg(figure, label), numbers, grid_relations(table, floor))


def grid_relations(table: dict[int, dict[int, float]], floor: dict[int, float]) -> tuple[Relation, ...]:
    """The relations of Figure 7 from the errors, k → r → mm, and the floors of PCA, k → mm."""
    over_floor = min(error / floor[k] for k, row in table.items() for error in row.values())
    widest = table[max(table)]
    least_r, most_r = min(widest), max(widest)
    at_most_r = [row[most_r] for _, row in sorted(table.items()) if most_r in row]
    first, last = sorted(widest)[:2], sorted(widest)[-2:]
    early = (widest[first[0]] - widest[first[1]]) / (first[1] - first[0])
    late = (widest[last[0]] - widest[last[1]]) / (last[1] - last[0])
    return (
        Relation("least error over the floor of PCA with the same k", over_floor, ">= 0.95"),
        Relation(f"error at the largest k, r {most_r} over r {least_r}", widest[most_r] / widest[least_r], "< 0.5"),
        Relation(f"error at r {most_r}, largest k over smallest", at_most_r[-1] / at_most_r[0], "< 1"),
        Relation("fall of the error a latent dimension, last step over first", late / early, "< 0.5"),
    )
