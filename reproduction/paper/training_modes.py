"""Figure 5: where the outer layers of the autoencoder begin, and in which space its loss is measured."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ldsim.arrays import Array
from ldsim.jit import one_thread
from ldsim.learn.examples import Examples
from ldsim.learn.options import TrainOptions
from ldsim.learn.training import train
from ldsim.report.svg import PALETTE, legend, log_scale, new_axes, to_svg
from ldsim.run import Run
from reproduction.harness import Harness
from reproduction.paper.experiment import Outcome, Relation
from reproduction.paper.full_space import train_full_space
from reproduction.paper.scenes import coarse_bar
from reproduction.reduced_runs import displacements

LATENT_DIMENSION, OUTER_DIMENSION = 5, 15
# Of the linear spaces beside them.
MODES_BESIDE = (5, 10)
# At a fixed rate the loss of the last epoch is luck; the error is the median of so large a share of epochs at the end.
LAST = 0.05
NAMES = {
    "random": "random start, full-space loss",
    "pca_trained": "PCA start, trained on",
    "pca_frozen": "PCA start, frozen",
    "pca_space": "loss in PCA coordinates",
}
LOOKS = {
    "random": ("second", "-"),
    "pca_trained": ("linear", "-"),
    "pca_frozen": ("linear", ":"),
    "pca_space": ("latent", "-"),
}


def training_modes(bench: Harness) -> Outcome:
    """Figure 5: mean squared error and training time of the four modes (a coarse beam, r 5, k 15, [200, 200]).

    All are trained by Adam at a fixed 10⁻³, and judged by the mean squared error of the displacements over the frames
    of an epoch. Seconds are the processor's, one thread.
    """
    epochs, width, repeats = (200, 60, 1) if bench.quick else (2000, 200, 3)
    options = TrainOptions(  # a single frame is kept back, for the others keep none
        kind="autoencoder", hidden=(width, width), epochs=epochs, batch=128, balance=0.0, validation_share=1e-6,
        optimiser="adam", schedule="fixed", learning_rate=1e-3,
    )  # fmt: skip
    with Run.open(bench.made(coarse_bar(bench.quick), "pca")) as run:
        u = np.concatenate([displacements(run, name) for name in run.snapshots.with_role("train")])
        u = u.reshape(len(u), -1)
        U = run.basis.columns(OUTER_DIMENSION).matrix
        told = f"Adam, {epochs} epochs, width {width}"
        rows = {
            name: [
                bench.remembered(
                    f"{name}, {told}, seed {seed}", lambda: _trained(u, U, options.replace(seed=seed), name)
                )
                for seed in range(repeats)
            ]
            for name in NAMES
        }
        linear = {k: float(np.square(_outside(u, U[:, :k])).mean()) for k in MODES_BESIDE}
    seeds = {name: [settled(row["mean_squared_error_m2"]) for row in own] for name, own in rows.items()}
    errors = {name: float(np.median(own)) for name, own in seeds.items()}
    seconds = {name: float(np.median([row["seconds"] for row in own])) for name, own in rows.items()}
    label = "Mean squared error of the four ways of training after each epoch, and of PCA"
    numbers = {"modes": rows, "settled_m2": seeds, "pca_mean_squared_error_m2": linear}
    return Outcome(to_svg(_drawn(rows, linear), label), numbers, mode_relations(errors, seconds, linear))


def settled(curve: list[float]) -> float:
    """The error that a training ends with."""
    return float(np.median(curve[-max(int(LAST * len(curve)), 1) :]))


def _outside(u: Array, U: Array) -> Array:
    """What of displacements (N, 3n) is not in the span of U, UᵀU = I."""
    return u - (u @ U) @ U.T


def _trained(u: Array, U: Array, options: TrainOptions, mode: str) -> dict[str, Any]:
    """Error over the training snapshots u (N, 3n) after each epoch, and the time that training took."""
    started = time.process_time()
    with one_thread():
        if mode == "pca_space":
            # what the basis misses is missed whatever is learned
            loss = train(Examples(u @ U), LATENT_DIMENSION, options).loss[:, 0]
            missed = float(np.square(_outside(u, U)).sum(axis=1).mean())
        else:
            loss, missed = train_full_space(u.astype(np.float32), U, LATENT_DIMENSION, options, mode).loss, 0.0
    seconds = time.process_time() - started
    return {"mean_squared_error_m2": ((loss + missed) / u.shape[1]).tolist(), "seconds": seconds}


def _drawn(rows: Mapping[str, Any], linear: Mapping[int, float]) -> Figure:
    figure, ax = new_axes("epoch", "mean squared error, m²", height=3.4)
    for name, own in rows.items():
        colour, line = LOOKS[name]
        for i, row in enumerate(own):
            curve = np.array(row["mean_squared_error_m2"])
            shown = np.unique(np.geomspace(1, len(curve), 200).astype(int))
            label = None if i else NAMES[name]
            ax.plot(shown, curve[shown - 1], color=PALETTE[colour], ls=line, lw=1.2, label=label)
    for k, value in linear.items():
        ax.axhline(value, color=PALETTE["full"], lw=1, ls=(0, (4, 2)))
        ax.annotate(f"PCA-{k}", (1, value), (2, 3), textcoords="offset points", fontsize=8, color=PALETTE["full"])
    log_scale(ax, "x")
    log_scale(ax, "y")
    legend(ax)
    return figure


def mode_relations(
    errors: dict[str, float], seconds: dict[str, float], linear: dict[int, float]
) -> tuple[Relation, ...]:
    """The relations of Figure 5 from errors, m², and seconds of each mode and the errors of PCA."""
    others = [name for name in errors if name != "pca_space"]
    return (
        Relation(
            "worst mode over PCA with the same dimension",
            max(errors.values()) / linear[MODES_BESIDE[0]],
            "<= 0.1",
            paper=8.8e-7 / 7.9e-6,
        ),
        Relation(
            "error of the loss in PCA coordinates over the best in full space",
            errors["pca_space"] / min(errors[name] for name in others),
            "<= 1",
            paper=4.1e-7 / 5.6e-7,
        ),
        Relation(
            "training time, fastest full-space loss over the loss in PCA coordinates",
            min(seconds[name] for name in others) / seconds["pca_space"],
            ">= 2",
            paper=456 / 195,
        ),
    )
