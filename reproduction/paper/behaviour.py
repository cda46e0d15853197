"""Figures 10, 14 and 15: one cubature point, a material changed after training, and a local pull."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ldsim.arrays import Array
from ldsim.cubature.choose import PoseSplit, choose_on_mesh, split_poses
from ldsim.cubature.options import FitOptions
from ldsim.cubature.samples import PoseSpace
from ldsim.dynamics.reduced.matrices import reduced_rest_stiffness
from ldsim.dynamics.trajectory import Trajectory
from ldsim.jit import one_thread
from ldsim.report.svg import PALETTE, legend, log_scale, new_axes, to_svg
from ldsim.run import Run
from ldsim.space.space import Space
from reproduction.harness import Harness
from reproduction.paper.experiment import Outcome, Relation
from reproduction.paper.minimisers import PAPER
from reproduction.paper.scenes import bar, catapult, dragon, elephant
from reproduction.paper.stills import farthest_frame, still
from reproduction.reduced_runs import a_step, displacements, latent, online_error, play, training_coordinates

LINEAR_MODES = 6
POSES = 100
# A space is bounded when it never moves farther than this many times what the full space does.
BOUND = 3.0
# Stiffer, not softer, so that the poses stay among those that the space was trained on.
STIFFER = 2.0


def one_cubature_point(bench: Harness) -> Outcome:
    """Figure 10: the catapult with a single cubature point, latent with r = 2 against PCA-6."""
    with Run.open(bench.made(catapult(bench.quick), "train")) as run, one_thread():
        motion, q = run.snapshots.names[0], training_coordinates(run)
        spaces = [latent(run), Space.linear(run.scene, run.basis, LINEAR_MODES)]
        played = {
            space.name: play(run, motion, _with_single_point(space, q[:, : space.decoder.k]), options=PAPER)
            for space in spaces
        }
        reach = {space.name: _reach(space, played[space.name]) for space in spaces}
        full = np.linalg.norm(displacements(run, motion), axis=2).max(axis=1)
        frame, u = farthest_frame(run, motion)
        moved = {"full": u} | {
            f"{space.name}, {space.r}, one point": _at(space, played[space.name], frame) for space in spaces
        }
        shown = still(run.scene, moved)
    figure, ax = new_axes("frame", "largest displacement, m", height=3.2)
    for space, values in {"full": full, **reach}.items():
        ax.plot(values, color=PALETTE[space], label=space)
    log_scale(ax, "y")
    legend(ax)
    over = {space: _largest(values) / float(full.max()) for space, values in reach.items()}
    evaluations = {space: a_step(trajectory.evaluations, trajectory) for space, trajectory in played.items()}
    relations = (
        Relation("largest displacement, latent with r = 2 over full space", over["latent"], f"<= {BOUND:g}"),
        Relation("linear with 6 modes diverges or leaves those bounds", float(not over["linear"] <= BOUND), ">= 1"),
        Relation(
            "evaluations a step, latent over linear",
            evaluations["latent"] / evaluations["linear"],
            "< 1",
            paper=7.9 / 30.5,
        ),
    )
    numbers = {
        "displacement_over_full": over,
        "evaluations": evaluations,
        "diverged": {space: trajectory.diverged for space, trajectory in played.items()},
    }
    label = "Largest displacement of the catapult over time with a single cubature point"
    return Outcome(to_svg(figure, label), numbers, relations, shown)


def _at(space: Space, trajectory: Trajectory, frame: int) -> Array:
    """The displacement in a frame, (n, 3) metres."""
    assert trajectory.coordinates is not None
    return space.displacement(trajectory.coordinates[frame])


def _with_single_point(space: Space, q: Array) -> Space:
    z = space.encoder(q)
    split = PoseSplit(*split_poses(len(z), min(POSES, len(z) - 1), 1, seed=0), recorded=len(z))
    poses = PoseSpace(space, reduced_rest_stiffness(space.scene, space.reduced_basis), z)
    options = FitOptions(tolerance=1e-6, max_points=1, norm="force")
    return space.with_rule(choose_on_mesh(poses, split, options).best)


def _reach(space: Space, trajectory: Trajectory) -> Array:
    """Largest displacement of any vertex in each frame, (N,) m; NaN once diverged."""
    assert trajectory.coordinates is not None
    u = space.displacement(trajectory.coordinates)
    return np.asarray(np.linalg.norm(u, axis=2).max(axis=1), dtype=np.float64)


def _largest(values: Array) -> float:
    return float(values.max()) if np.isfinite(values).all() else float("inf")


def cubature_against_every_element(bench: Harness) -> Outcome:
    """Figure 11: the dragon at E = 1e5 Pa against full space, latent and linear, with and without cubature."""
    with Run.open(bench.made(dragon(bench.quick), "cubature")) as run, one_thread():
        motion = run.snapshots.names[0]
        spaces = {"linear": Space.linear(run.scene, run.basis, run.model.kp), "latent": latent(run)}
        rules = {name: run.cubature[name].best for name in spaces}
        played = {
            name: {
                "every element": play(run, motion, space),
                "cubature": play(run, motion, space.with_rule(rules[name]), options=PAPER),
            }
            for name, space in spaces.items()
        }
        frame, u = farthest_frame(run, motion)
        reduced = {
            f"{name}, {space.r}, cubature": _at(space, played[name]["cubature"], frame)
            for name, space in spaces.items()
        }
        shown = still(run.scene, {"full": u} | reduced)
    figure, ax = new_axes("frame", "mean vertex error, mm", height=3.2)
    for name, both in played.items():
        for how, trajectory in both.items():
            assert trajectory.mean_error is not None
            line = "-" if how == "cubature" else ":"
            label = f"{name}, {how}"
            ax.plot(1e3 * trajectory.mean_error, color=PALETTE[name], ls=line, lw=1.3, label=label)
    legend(ax)
    errors = {name: {how: online_error(t) for how, t in both.items()} for name, both in played.items()}
    every, few = errors["latent"].values()
    step = {name: 1e3 * float(np.nanmedian(both["cubature"].seconds)) for name, both in played.items()}
    relations = (
        Relation("online error of the latent space with every element", every, "<= 0.1"),
        Relation("what cubature adds to it", few - every, "<= 0.01"),
        Relation(
            "online error with every element, latent over linear", every / errors["linear"]["every element"], "<= 1"
        ),
        Relation("linear step over latent step, cubature", step["linear"] / step["latent"], ">= 1", paper=185 / 157),
    )
    label = "Mean vertex error of the dragon over time, with every element and with cubature"
    numbers = {
        "dimension": {name: space.r for name, space in spaces.items()},
        "points": {name: len(rule.points) for name, rule in rules.items()},
        "online_error": errors,
        "median_step_ms": step,
    }
    return Outcome(to_svg(figure, label), numbers, relations, shown)


def material_after_training(bench: Harness) -> Outcome:
    """Figure 14: the bar at E = 1e5 Pa as trained, and stiffened after training, against the full space."""
    folder = bench.made(bar(bench.quick), "train")
    other = bench.made(bar(bench.quick, youngs_modulus=STIFFER * 1e5), "snapshot")
    with Run.open(folder) as run, Run.open(other) as stiffer, one_thread():
        motion, space = run.snapshots.with_role("train")[0], latent(run)
        scene = replace(run.scene, mu=STIFFER * run.scene.mu, lam=STIFFER * run.scene.lam)
        as_trained = play(run, motion, space)
        changed = play(stiffer, motion, replace(space, scene=scene))
        unchanged = play(stiffer, motion, space)
        frame, u = farthest_frame(stiffer, motion)
        shown = still(run.scene, {"full, stiffened": u, "latent, stiffened": _at(space, changed, frame)})
    curves = {"as trained": as_trained, "stiffened after training": changed}
    figure, ax = new_axes("frame", "mean vertex error, mm", height=3.2)
    for i, (label, trajectory) in enumerate(curves.items()):
        assert trajectory.mean_error is not None
        ax.plot(1e3 * trajectory.mean_error, color=PALETTE["latent"], alpha=1 - 0.5 * i, label=label)
    legend(ax)
    errors = {label: online_error(trajectory) for label, trajectory in curves.items()}
    errors["stiffened, material not changed"] = online_error(unchanged)
    relations = (
        Relation("online error as trained", errors["as trained"], "<= 0.05"),
        Relation("online error, twice the modulus set after training", errors["stiffened after training"], "<= 0.1"),
        Relation(
            "the same over that of the model with its old modulus",
            errors["stiffened after training"] / errors["stiffened, material not changed"],
            "< 1",
        ),
    )
    label = "Mean vertex error of the bar over time, as trained and with another modulus set after training"
    return Outcome(to_svg(figure, label), {"online_error": errors}, relations, shown)


def local_pull(bench: Harness) -> Outcome:
    """Figure 15: a pull on the elephant's arm moves the far half of a reduced elephant more than the full one's."""
    name = "local_effect"
    with Run.open(bench.made(elephant(bench.quick), "train")) as run, one_thread():
        recorded, x = run.recorded(name), run.scene.mesh.vertices
        held = x[recorded.held[0]].mean(axis=0)
        distance = np.linalg.norm(x - held, axis=1)
        far = distance > np.median(distance)
        full = _pulled_less_unpulled(displacements(run, name))
        space = latent(run)
        played = play(run, name, space)
        assert played.coordinates is not None
        moved = {"full": full, "latent": _pulled_less_unpulled(space.displacement(played.coordinates))}
        shares = {name: _share(u, far) for name, u in moved.items()}
        last = {name: u[-1] for name, u in moved.items()}
        shown = still(run.scene, last)
    figure, ax = new_axes("frame", "mean displacement of the far half, mm", height=3.2)
    for label, u in moved.items():
        ax.plot(1e3 * np.linalg.norm(u[:, far], axis=2).mean(axis=1), color=PALETTE[label], label=label)
    legend(ax)
    relations = (
        Relation(
            "share of the motion in the half far from the pull, latent over full",
            shares["latent"] / shares["full"],
            ">= 1.2",
        ),
    )
    numbers = {"far_share": shares, "online_error": online_error(played)}
    label = "Motion of the half of the elephant far from a local pull"
    return Outcome(to_svg(figure, label), numbers, relations, shown)


def _pulled_less_unpulled(u: Array) -> Array:
    """Displacements (N, n, 3) relative to those of the first frame, before the pull has moved anything."""
    assert len(u) > 1
    return u - u[:1]


def _share(u: Array, far: NDArray[np.bool_]) -> float:
    """How much of the vertices' summed motion is in the far half."""
    moved = np.linalg.norm(u, axis=2).sum(axis=0)
    return float(moved[far].sum() / moved.sum())
