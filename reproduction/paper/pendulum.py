"""Figures 2 and 3: a pendulum that swings on one axis needs two linear coordinates or one nonlinear one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ldsim.arrays import Array
from ldsim.report.svg import PALETTE, legend, new_axes, to_svg
from ldsim.run import Run
from ldsim.space.space import Space
from reproduction.harness import Harness
from reproduction.paper.experiment import Outcome, Relation
from reproduction.paper.scenes import Configuration
from reproduction.paper.stills import farthest_frame, still
from reproduction.reduced_runs import displacements, largest_error, latent, online_error, play, training_coordinates

LENGTH, REACH = 0.27, np.deg2rad(60)
PIN = 0.001


def swing(frames: int) -> str:
    """A recording: the bob is led along its circle to one side, to the other, and back."""
    angle = REACH * np.sin(2 * np.pi * np.arange(1, frames + 1) / frames)
    rows = np.stack([LENGTH * np.sin(angle), -LENGTH * np.cos(angle), np.zeros(frames)], axis=1)
    lines = ["# spring_stiffness_n_per_m: 100", "# grab_radius_m: 0.03"]
    lines.append("is_dragging,target_x,target_y,target_z,grabbed_x,grabbed_y,grabbed_z")
    lines += [f"1,{x:.9g},{y:.9g},{z:.9g},0,{-LENGTH},0" for x, y, z in rows]
    return "\n".join(lines) + "\n"


def _configuration(bench: Harness) -> Configuration:
    frames, resolution = (200, 1) if bench.quick else (800, 2)
    # one file for both figures, which share the run
    recording = replace(bench, name="pendulum").file(f"swing_{frames}.csv", swing(frames))
    return {
        "experiment": "paper-pendulum-quick" if bench.quick else "paper-pendulum",
        "mesh": {
            "shape": {"name": "pendulum", "resolution": resolution},
            "material": {"youngs_modulus": 1e6},
            "pins": [{"slab": {"axis": "y", "at": "max", "thickness": PIN}}],
            "time_step": 0.01,
        },
        "snapshot": {"motions": [{"name": "swing", "recording": str(recording)}]},
        "pca": {"k": 10},
        "train": {"kind": "autoencoder", "r": 1, "epochs": 800 if bench.quick else 3000, "batch": 32},
    }


def _bob(run: Run, u: Array) -> Array:
    """The path of the bob's lowest vertices' centroid, (N, 3), m, for displacements (N, n, 3)."""
    rest = run.scene.mesh.vertices
    lowest = rest[:, 1] < rest[:, 1].min() + 1e-6
    path: Array = (rest + u)[:, lowest].mean(axis=1)
    return path


def _draw(paths: dict[str, Array], label: str) -> str:
    figure, ax = new_axes("x, m", "y, m", height=3.4)
    colours = {
        "full": PALETTE["full"],
        "PCA-1": PALETTE["linear"],
        "PCA-2": PALETTE["second"],
        "autoencoder-1": PALETTE["latent"],
    }
    for name, path in paths.items():
        wide = 4.0 if name == "full" else 1.5
        ax.plot(path[:, 0], path[:, 1], color=colours[name], lw=wide, alpha=0.5 if name == "full" else 1, label=name)
    ax.set_aspect("equal", adjustable="datalim")
    legend(ax)
    return to_svg(figure, label)


def one_coordinate_is_enough(bench: Harness) -> Outcome:
    """Figure 2: the snapshots of the swing as each space can represent them."""
    with Run.open(bench.made(_configuration(bench), "train")) as run:
        q = training_coordinates(run)
        decoded = {
            "PCA-1": q[:, :1],
            "PCA-2": q[:, :2],
            "autoencoder-1": run.model.decoder(run.model.encoder(q)),
        }
        errors = {name: largest_error(run, values) for name, values in decoded.items()}
        paths = {"full": _bob(run, displacements(run, "swing"))}
        paths |= {
            name: _bob(run, run.basis.columns(values.shape[1]).displacement(values)) for name, values in decoded.items()
        }
    relations = (
        Relation(
            "largest vertex error, one linear over one nonlinear coordinate",
            errors["PCA-1"] / errors["autoencoder-1"],
            ">= 5",
        ),
        Relation(
            "largest vertex error, one nonlinear over two linear coordinates",
            errors["autoencoder-1"] / errors["PCA-2"],
            "<= 1",
        ),
    )
    figure = _draw(paths, "Path of the bob as one or two linear coordinates and one nonlinear one represent it")
    return Outcome(figure, {"max_mm": errors}, relations)


def larger_bends(bench: Harness) -> Outcome:
    """Figure 3: the swing simulated with one degree of freedom, linear and nonlinear."""
    with Run.open(bench.made(_configuration(bench), "train")) as run:
        spaces = {f"PCA-{k}": Space.linear(run.scene, run.basis, k) for k in (1, 2)} | {"autoencoder-1": latent(run)}
        runs = {name: play(run, "swing", space) for name, space in spaces.items()}
        errors = {name: online_error(result) for name, result in runs.items()}
        paths = {"full": _bob(run, displacements(run, "swing"))}
        frame, u = farthest_frame(run, "swing")
        poses = {"full": u}
        for name, result in runs.items():
            assert result.coordinates is not None
            paths[name] = _bob(run, spaces[name].displacement(result.coordinates))
            poses[name] = spaces[name].displacement(result.coordinates[frame])
        shown = still(run.scene, poses)
    rise = {name: float(np.nanmax(path[:, 1]) - paths["full"][0, 1]) for name, path in paths.items()}
    relations = (
        Relation(
            "online error at one degree of freedom, nonlinear over linear",
            errors["autoencoder-1"] / errors["PCA-1"],
            "<= 0.5",
        ),
        Relation("height the bob rises to, nonlinear over full space", rise["autoencoder-1"] / rise["full"], ">= 0.9"),
        Relation("height the bob rises to, linear over full space", rise["PCA-1"] / rise["full"], "<= 0.5"),
    )
    figure = _draw(paths, "Path of the bob simulated with one or two linear coordinates and one nonlinear one")
    return Outcome(figure, {"online_error": errors, "rise_m": rise}, relations, shown)
