"""Section 4's other networks: ReLU in the place of ELU, a denoising and a variational autoencoder."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ldsim.jit import one_thread
from ldsim.learn.examples import Examples
from ldsim.learn.options import Denoising, LossTerm, TrainOptions
from ldsim.learn.training import train
from ldsim.report.svg import PALETTE, log_scale, new_axes, to_svg
from ldsim.run import Run
from ldsim.space.space import Space
from reproduction.harness import Harness
from reproduction.paper.experiment import Outcome, Relation
from reproduction.paper.scenes import cross
from reproduction.reduced_runs import a_step, displacements, largest_error, online_error, play, training_coordinates

# The paper's training (Sec. 4.3).
PAPER = TrainOptions(
    kind="autoencoder",
    balance=0.0,
    optimiser="adam",
    schedule="fixed",
    learning_rate=1e-3,
    batch=256,
    validation_share=0.1,
)
# The paper says neither how much noise nor which weight; these are ours.
KINDS = {
    "ELU": PAPER,
    "ReLU": PAPER.replace(activation="relu"),
    "denoising": PAPER.replace(denoising=Denoising(noise=0.1)),
    "variational": PAPER.replace(variational=LossTerm(weight=1e-3)),
}
FRAMES = 300


def networks(bench: Harness) -> Outcome:
    """Training error, online error and jitter of four autoencoders of one size (X, the paper's r, 100 × 100)."""
    epochs, repeats = (200, 1) if bench.quick else (2500, 3)
    with Run.open(bench.made(cross(bench.quick), "cubature")) as run:
        motion, r, k = run.snapshots.with_role("train")[0], run.model.decoder.r, run.model.decoder.k
        rule, q = run.cubature["linear"].best, training_coordinates(run)[:, :k]
        full = displacements(run, motion)[:FRAMES]

        def measured(options: TrainOptions) -> dict[str, Any]:
            with one_thread():
                trained = train(Examples(np.ascontiguousarray(q)), r, options)
                space = Space.latent(run.scene, run.basis.columns(k), (trained.decoder, trained.encoder), rule)
                played = play(run, motion, space, frames=FRAMES)
            assert played.coordinates is not None
            return {
                "max_mm": largest_error(run, trained.decoder(trained.encoder(q))),
                "online_error": online_error(played),
                "jitter_over_full": jitter(space.displacement(played.coordinates)) / jitter(full),
                "evaluations": a_step(played.evaluations, played),
            }

        table = {
            kind: [
                bench.remembered(
                    f"{kind}, {epochs} epochs, seed {seed}",
                    lambda: measured(options.replace(epochs=epochs, seed=seed)),
                )
                for seed in range(repeats)
            ]
            for kind, options in KINDS.items()
        }
    middle = {kind: _middle(rows) for kind, rows in table.items()}
    figure, ax = new_axes("largest vertex error of the training frames, mm", "online error, %", height=3.2)
    for kind, row in middle.items():
        ax.plot(row["max_mm"], 100 * row["online_error"], "o", color=PALETTE["latent"])
        ax.annotate(kind, (row["max_mm"], 100 * row["online_error"]), (6, 3), textcoords="offset points", fontsize=9)
    for axis in "xy":
        log_scale(ax, axis)
    elu = middle["ELU"]
    relations = (
        Relation("largest training error, ReLU over ELU", middle["ReLU"]["max_mm"] / elu["max_mm"], "<= 1.5"),
        Relation("jitter, ReLU over ELU", middle["ReLU"]["jitter_over_full"] / elu["jitter_over_full"], "> 1"),
        Relation(
            "online error, denoising over plain", middle["denoising"]["online_error"] / elu["online_error"], ">= 1"
        ),
        Relation(
            "online error, variational over plain", middle["variational"]["online_error"] / elu["online_error"], ">= 1"
        ),
        Relation(
            "largest training error, variational over plain", middle["variational"]["max_mm"] / elu["max_mm"], ">= 1"
        ),
    )
    label = "Online error against the largest training error of four kinds of autoencoder"
    return Outcome(to_svg(figure, label), {"middle": middle, "runs": table}, relations)


def jitter(u: np.ndarray[Any, Any]) -> float:
    """Root mean square of the second difference in time of displacements (N, n, 3), metres; NaN once lost."""
    return float(np.sqrt(np.square(np.diff(u, n=2, axis=0)).mean()))


def _or_infinite(value: float | None) -> float:
    return math.inf if value is None or not math.isfinite(value) else value


def _middle(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Of several seeds the middle one of each number; a lost one counts as infinite."""
    return {key: float(np.median([_or_infinite(row[key]) for row in rows])) for key in rows[0]}
