"""`ldsim cubature`: choose the cubature points of the latent and of the matching linear space."""

from __future__ import annotations

import time

import click
import numpy as np

from ldsim.artefacts.records import StoredCubature, read_basis, read_model, read_scene, write_cubature
from ldsim.artefacts.snapshots import Snapshots
from ldsim.cli.stage import Run, progress_bar, stage_command
from ldsim.reduction.cubature.forces import ProjectedForces
from ldsim.reduction.cubature.selection import fit_and_judge, split_poses
from ldsim.reduction.decoder import Decoder
from ldsim.reduction.pca import inner_product
from ldsim.reduction.reconstruction import all_coordinates
from ldsim.threads import one_thread


@stage_command("cubature", "Choose the cubature points of the latent and of the matching linear space.")
def command(run: Run) -> None:
    settings = run.settings.cubature
    scene, _ = read_scene(run.path("scene"))
    stored, basis_header = read_basis(run.path("basis"))
    model, header = read_model(run.path("model"))
    run.check("basis", basis_header, "scene")
    run.check("model", header, "snapshots", "basis")
    U = stored.basis.U
    metric = inner_product(scene.mass, run.settings.pca.inner_product)
    with Snapshots(run.path("snapshots")) as snapshots:
        names = snapshots.with_role("train")
        q = all_coordinates(lambda: snapshots.chunks(names), metric, U)
    fitted, kept_back = split_poses(len(q), settings.poses, settings.heldout_poses, settings.seed)
    linear = np.ascontiguousarray(U[:, : model.kp])
    problems = {
        "latent": (U, model.decoder, model.encoder(q), settings.max_points),
        "linear": (linear, Decoder.identity(model.kp), q[:, : model.kp], settings.linear_max_points),
    }
    spaces: dict[str, StoredCubature] = {}
    seconds: dict[str, float] = {}
    for space, (basis, decoder, z, most) in problems.items():
        started = time.perf_counter()
        with one_thread(), progress_bar(None, f"cubature {space}", "set") as bar:

            def show(points: int, error: float) -> None:
                bar.set_postfix_str(f"{points} points, relative error {error:.3f}", refresh=False)
                bar.update()

            result, heldout = fit_and_judge(
                lambda poses: ProjectedForces(scene, basis, decoder, z[poses]),
                fitted,
                kept_back,
                settings.tolerance,
                most,
                show,
            )
        spaces[space] = StoredCubature(result.ladder, heldout, len(result.ladder) - 1)
        seconds[f"{space}_seconds"] = time.perf_counter() - started
        if not result.met:
            click.echo(
                f"warning: the {space} cubature reached a relative error of {result.best.training_error:.3f}, "
                f"asked were {settings.tolerance:g} with at most {most} points",
                err=True,
            )
    inputs = ("scene", "snapshots", "basis", "model")
    write_cubature(run.path("cubature"), run.header("cubature", "cubature", inputs, settings.seed, **seconds), spaces)
    run.done(
        "cubature",
        "; ".join(
            f"{space}: {len(entry.best.points)} points, relative error {entry.best.training_error:.3f}, held out "
            f"{entry.heldout_errors[entry.chosen]:.3f}"
            for space, entry in spaces.items()
        ),
    )
