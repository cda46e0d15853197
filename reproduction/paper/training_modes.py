"""Figure 5: where the outer layers of the autoencoder begin, and in which space its loss is measured."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ldsim.jit import one_thread
from ldsim.learn.examples import Examples
from ldsim.learn.options import TrainOptions
from ldsim.learn.training import train
from ldsim.report.svg import PALETTE, log_scale, new_axes, to_svg
from ldsim.run import Run
from reproduction.harness import Harness
from reproduction.paper.experiment import Outcome, Relation
from reproduction.paper.full_space import train_full_space
from reproduction.paper.scenes import coarse_bar
from reproduction.reduced_runs import displacements

Array = NDArray[np.float64]

LATENT_DIMENSION, OUTER_DIMENSION = 5, 15
# The full-space losses are trained by Adam, whose steps are another size than SOAP's, which trains the fourth mode.
ADAM_RATE = 1e-3
# Of the linear spaces beside them.
MODES_BESIDE = (5, 10)
NAMES = {
    "random": "random start, full-space loss",
    "pca_trained": "PCA start, trained on",
    "pca_frozen": "PCA start, frozen",
    "pca_space": "loss in PCA coordinates",
}


def training_modes(bench: Harness) -> Outcome:
    """Figure 5: mean squared error and training time of the four modes (a coarse beam, r 5, k 15, [200, 200])."""
    epochs, width = (200, 60) if bench.quick else (2000, 200)
    options = TrainOptions(hidden=(width, width), epochs=epochs, batch=128, balance=0.0, validation_share=0.01)
    with Run.open(bench.made(coarse_bar(bench.quick), "pca")) as run:
        u = np.concatenate([displacements(run, name) for name in run.snapshots.with_role("train")])
        u = u.reshape(len(u), -1)
        U = run.basis.columns(OUTER_DIMENSION).matrix
        rows = {
            name: bench.remembered(f"{name}, {epochs} epochs, width {width}", lambda: _measured(u, U, options, name))
            for name in NAMES
        }
        linear = {k: _squared_error(u, u @ U[:, :k] @ U[:, :k].T) for k in MODES_BESIDE}
    errors = {name: float(row["mean_squared_error_m2"]) for name, row in rows.items()}
    seconds = {name: float(row["seconds"]) for name, row in rows.items()}
    label = "Mean squared error of the four ways of training, and of PCA; lower is better"
    numbers = {"modes": rows, "pca_mean_squared_error_m2": linear}
    return Outcome(to_svg(_drawn(errors, linear), label), numbers, mode_relations(errors, seconds, linear))


def _measured(u: Array, U: Array, options: TrainOptions, mode: str) -> dict[str, Any]:
    """Error over the training snapshots u (N, 3n) and the time that training took."""
    started = time.perf_counter()
    with one_thread():
        if mode == "pca_space":
            basis, trained = U, train(Examples(u @ U), LATENT_DIMENSION, options)
            decoder, encoder = trained.decoder, trained.encoder
        else:
            by_adam = options.replace(learning_rate=ADAM_RATE)
            found = train_full_space(u.astype(np.float32), U, LATENT_DIMENSION, by_adam, mode)
            basis, decoder, encoder = found.U, found.decoder, found.encoder
    seconds = time.perf_counter() - started
    error = _squared_error(u, decoder(encoder(u @ basis)) @ basis.T)
    return {"mean_squared_error_m2": error, "seconds": seconds}


def _squared_error(u: Array, decoded: Array) -> float:
    return float(np.square(decoded - u).mean())


def _drawn(errors: dict[str, float], linear: dict[int, float]) -> Figure:
    figure, ax = new_axes("", "mean squared error, m²", height=3.2)
    bars = {**{NAMES[name]: (value, PALETTE["latent"]) for name, value in errors.items()}}
    bars |= {f"PCA-{k}": (value, PALETTE["linear"]) for k, value in linear.items()}
    for place, (value, colour) in enumerate(bars.values()):
        ax.bar(place, value, color=colour, width=0.6)
    ax.set_xticks(range(len(bars)), [name.replace(", ", ",\n") for name in bars], fontsize=7)
    log_scale(ax, "y")
    return figure


def mode_relations(
    errors: dict[str, float], seconds: dict[str, float], linear: dict[int, float]
) -> tuple[Relation, ...]:
    """The relations of Figure 5 from errors, m², and seconds of each mode and the errors of PCA."""
    others = [name for name in errors if name != "pca_space"]
    return (
        Relation(
            "worst mode over PCA with the same dimension", max(errors.values()) / linear[MODES_BESIDE[0]], "<= 0.1"
        ),
        Relation(
            "error of the loss in PCA coordinates over the best in full space",
            errors["pca_space"] / min(errors[name] for name in others),
            "<= 1",
        ),
        Relation(
            "training time, fastest full-space loss over the loss in PCA coordinates",
            min(seconds[name] for name in others) / seconds["pca_space"],
            ">= 2",
        ),
    )
