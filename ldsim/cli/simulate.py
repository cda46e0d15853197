"""`ldsim simulate`: run the motions in the full, linear and latent space and compare."""

from __future__ import annotations

from dataclasses import replace

import click
import numpy as np

from ldsim.artefacts.records import StoredCubature, read_basis, read_cubature, read_model, read_scene
from ldsim.artefacts.simulation import write_simulation
from ldsim.artefacts.snapshots import Snapshots
from ldsim.cli.stage import Call, progress_bar, stage_command
from ldsim.cubature.rule import CubatureRule
from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.trajectory import Trajectory
from ldsim.errors import SettingsError
from ldsim.jit import one_thread
from ldsim.mechanics.properties import Change
from ldsim.mechanics.scene import properties_of, with_properties
from ldsim.optimise.solution import Reason
from ldsim.pipeline.comparison import Reference, compare_motion
from ldsim.space.novelty import Novelty
from ldsim.space.space import Space


@stage_command("simulate", "Run the motions in the full, linear and latent space and compare.")
def command(run: Call) -> None:
    settings = run.settings.simulate
    scene, _ = read_scene(run.path("scene"))
    stored, _ = read_basis(run.path("basis"), scene)
    model, _ = read_model(run.path("model"))
    cubature, header = read_cubature(run.path("cubature"))
    run.check("cubature", header, "scene", "snapshots", "basis", "model")
    changed = settings.material is not None
    if settings.material is not None:
        scene = with_properties(scene, properties_of(scene).changed(Change.of(settings.material)))
    networks = (model.decoder, model.encoder)
    spaces = [
        Space.linear(scene, stored.basis, model.kp, _rule(cubature["linear"], settings.linear_points, changed)),
        Space.latent(scene, stored.basis, networks, _rule(cubature["latent"], settings.points, changed)),
    ]
    options = ReducedOptions(tolerance=settings.tolerance, max_iterations=settings.max_iterations)
    runs: dict[str, dict[str, Trajectory]] = {"full": {}, "linear": {}, "latent": {}}
    minimisers: dict[str, str] = {}
    with Snapshots(run.path("snapshots")) as snapshots, one_thread():
        names = _motions(settings.motions, snapshots.names)
        steps = sum((2 if changed else 4) * snapshots.frames(name) for name in names)
        with progress_bar(steps, "simulate", "step") as bar:
            for name in names:
                bar.set_postfix_str(
                    f"{name} (the first step compiles the kernels, about a minute)" if bar.n == 0 else name
                )
                recorded = snapshots.recorded(name)
                frames = None if changed else snapshots.reader(name)
                reference = Reference(recorded.motion, recorded.held, frames)
                for space, trajectory, minimiser in compare_motion(
                    spaces, reference, options, settings.full_frames, settings.window, bar.update
                ):
                    runs[space][name] = _with_novelty(trajectory, model.novelty)
                    minimisers[f"{space}_minimiser"] = minimiser
    inputs = ("scene", "snapshots", "basis", "model", "cubature")
    write_simulation(
        run.path("simulation"),
        run.header("simulation", "simulate", inputs, -1, **minimisers, material_changed=int(changed)),
        runs,
    )
    run.done("simulation", "; ".join(_summary(space, motions) for space, motions in runs.items()))
    _warn_of_failed_steps(runs)
    _warn_of_novelty(runs, model.novelty)


def _rule(stored: StoredCubature, points: int | None, changed: bool) -> CubatureRule:
    """Points of the mesh where so many are asked for, or the material is another than that of the virtual points."""
    if points is not None:
        return stored.at_most(points)
    return stored.best if changed else stored.stepped


def _motions(wanted: tuple[str, ...] | None, known: list[str]) -> list[str]:
    unknown = [name for name in wanted or () if name not in known]
    if unknown:
        raise SettingsError(f"simulate.motions names {unknown[0]!r}; the snapshots hold {', '.join(known)}")
    return list(wanted) if wanted is not None else known


def _summary(space: str, motions: dict[str, Trajectory]) -> str:
    seconds = np.concatenate([trajectory.seconds for trajectory in motions.values()])
    return f"{space} {1e3 * np.nanmedian(seconds):.3g} ms a step"


def _with_novelty(trajectory: Trajectory, novelty: Novelty | None) -> Trajectory:
    if novelty is None or trajectory.latent is None:
        return trajectory
    return replace(trajectory, novelty=novelty(trajectory.latent))


def _warn_of_novelty(runs: dict[str, dict[str, Trajectory]], novelty: Novelty | None) -> None:
    for name, trajectory in runs["latent"].items():
        if novelty is None or trajectory.novelty is None:
            continue
        far = int((trajectory.novelty > novelty.threshold).sum())
        if far:
            click.echo(
                f"warning: {name} in the latent space: {far} of {len(trajectory.novelty)} frames are far from the "
                f"training motions (score up to {np.nanmax(trajectory.novelty):.2g}, threshold "
                f"{novelty.threshold:.2g}); train on motions like it",
                err=True,
            )


def _warn_of_failed_steps(runs: dict[str, dict[str, Trajectory]]) -> None:
    for space, motions in runs.items():
        for name, trajectory in motions.items():
            failed = int((trajectory.reason != Reason.CONVERGED).sum())
            if trajectory.diverged:
                click.echo(f"warning: {name} in the {space} space diverged", err=True)
            elif failed:
                worst = Reason(int(trajectory.reason.max())).words
                click.echo(f"warning: {name} in the {space} space: {failed} steps did not converge ({worst})", err=True)
