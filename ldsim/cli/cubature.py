"""`ldsim cubature`: choose the cubature points of the latent and of the matching linear space."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import click
import numpy as np
from numpy.typing import NDArray

from ldsim.artefacts.records import StoredCubature, StoredModel, read_basis, read_model, read_scene, write_cubature
from ldsim.artefacts.snapshots import Snapshots
from ldsim.cli.stage import Call, progress_bar, stage_command
from ldsim.cubature.goal import Goal
from ldsim.cubature.ladder import VirtualSelection
from ldsim.cubature.rule import CubatureRule
from ldsim.cubature.selection import PoseSpace, Recipe, Selection, select, split_poses
from ldsim.cubature.virtual import Judge, VirtualRecipe, select_virtual
from ldsim.dynamics.reduced.stepper import reduced_rest_stiffness
from ldsim.jit import one_thread
from ldsim.mechanics.scene import Scene
from ldsim.pipeline.comparison import Reference, windowed_error
from ldsim.settings import CubatureSettings
from ldsim.space.basis import Basis
from ldsim.space.decoder import Decoder
from ldsim.space.encoder import Encoder
from ldsim.space.lifting import Lifting
from ldsim.space.projection import all_coordinates
from ldsim.space.space import Space

Array = NDArray[np.float64]

# Seconds between restarts of the runs that virtual points are judged by.
WINDOW = 0.25
# Status of a run whose artefact is whole but whose set misses the tolerance; stages/cubature.mk goes on after it.
MISSED = 3


@stage_command("cubature", "Choose the cubature points of the latent and of the matching linear space.")
def command(run: Call) -> None:
    settings = run.settings.cubature
    scene, _ = read_scene(run.path("scene"))
    stored, basis_header = read_basis(run.path("basis"), scene)
    model, header = read_model(run.path("model"))
    run.check("basis", basis_header, "scene")
    run.check("model", header, "snapshots", "basis")
    U = stored.basis.matrix
    recipe = _recipe(settings)
    linear = replace(recipe, goal=replace(recipe.goal, max_points=settings.linear_max_points), closure=0.0, latent=True)
    spaces: dict[str, StoredCubature] = {}
    seconds: dict[str, float] = {}
    missed = False
    with Snapshots(run.path("snapshots")) as snapshots:
        names = snapshots.with_role("train")
        motions = [snapshots.recorded(name).motion for name in names]
        lifting = Lifting.of(scene, motions)
        q = all_coordinates(lifting.taken_off(lambda: snapshots.chunks(names), motions), stored.basis)
        read, recorded = snapshots.frame_reader(names), len(q)
        if model.synthetic is not None:
            q = np.concatenate([q, model.synthetic])

        def true_pose(t: int) -> NDArray[np.floating]:
            return read(t) if t < recorded else (U @ q[t]).reshape(-1, 3)

        fitted, kept_back = split_poses(len(q), settings.poses, settings.heldout_poses, settings.seed)
        pins = lifting.fields, np.pad(lifting.all_coordinates(motions), ((0, len(q) - recorded), (0, 0)))
        for name, space in _pose_spaces(scene, stored.basis, model, q, true_pose, pins).items():
            started = time.perf_counter()
            with one_thread(), progress_bar(None, f"cubature {name}", "set") as bar:

                def show(points: int, error: float) -> None:
                    bar.set_postfix_str(f"{points} points, relative error {error:.3f}", refresh=False)
                    bar.update()

                found = select(space, fitted, kept_back, recipe if name == "latent" else linear, show)
            ladder = found.fit.ladder
            judge = None
            if not run.settings.snapshot.quasistatic:
                encoder = model.encoder if name == "latent" else Encoder((), ())
                judge = _judge(scene, stored.basis, space, encoder, snapshots, name)
            virtual = _virtual(name, space, found, kept_back, recorded, settings, judge)
            spaces[name] = StoredCubature(
                ladder, found.heldout_errors, len(ladder) - 1, found.perturbed_errors, virtual
            )
            seconds[f"{name}_seconds"] = time.perf_counter() - started
            missed |= not found.fit.met
            _warn(name, found, settings)
    inputs = ("scene", "snapshots", "basis", "model")
    write_cubature(run.path("cubature"), run.header("cubature", "cubature", inputs, settings.seed, **seconds), spaces)
    run.done("cubature", "; ".join(_summary(name, entry) for name, entry in spaces.items()))
    if missed:
        raise click.exceptions.Exit(MISSED)


def _recipe(settings: CubatureSettings) -> Recipe:
    """The recipe of the latent set."""
    return Recipe(
        Goal(settings.tolerance, settings.max_points, settings.volume, settings.seed),
        settings.method,
        settings.project == "latent",
        settings.norm == "compliance",
        settings.closure,
        settings.perturbed,
        settings.perturbation,
        settings.tangent,
        settings.energy,
        settings.candidates,
        settings.threads,
    )


def _virtual(
    name: str,
    space: PoseSpace,
    found: Selection,
    kept_back: NDArray[np.int64],
    recorded: int,
    settings: CubatureSettings,
    judge: Judge | None,
) -> VirtualSelection | None:
    """The virtual points of a space, where some are asked for and worth having."""
    asked = settings.virtual
    points = asked.points if name == "latent" else asked.linear_points
    if not points:
        return None
    recipe = VirtualRecipe(
        points, asked.poses, asked.closures, asked.steps, asked.batch, asked.rate, settings.seed, settings.threads
    )
    with one_thread(), progress_bar(asked.steps * len(asked.closures), f"cubature {name}, virtual", "step") as bar:
        bar.set_postfix_str("forces of the poses")

        def show(step: int, error: float) -> None:
            bar.set_postfix_str(f"relative error {error:.3f}", refresh=False)
            bar.update(step - bar.n)

        virtual = select_virtual(space, found.fit.ladder, kept_back, recorded, recipe, judge, show)
    if virtual.worse_than_mesh:
        errors = ", ".join(f"{error:.3g} with closure {share:g}" for share, error in virtual.tried[1:])
        click.echo(
            f"note: no virtual points for the {name} space: on the training motions they are off by {errors}, and "
            f"{len(found.fit.best.points)} points of the mesh by {virtual.tried[0, 1]:.3g}",
            err=True,
        )
        return None
    return virtual


def _judge(scene: Scene, basis: Basis, space: PoseSpace, encoder: Encoder, snapshots: Snapshots, name: str) -> Judge:
    """The windowed online error of a set on the training motions, one after another."""
    names = snapshots.with_role("train")

    def judge(cubature: CubatureRule) -> float:
        reduced = Space(name, scene, basis.columns(space.decoder.k), space.decoder, encoder, cubature)
        errors = []
        for motion in names:
            recorded = snapshots.recorded(motion)
            reference = Reference(recorded.motion, recorded.held, snapshots.reader(motion))
            errors.append(windowed_error(reduced, reference, WINDOW))
        return float(np.average(errors, weights=[snapshots.frames(motion) for motion in names]))

    return judge


def _pose_spaces(
    scene: Scene,
    basis: Basis,
    model: StoredModel,
    q: Array,
    displacement: Callable[[int], NDArray[np.floating]],
    pins: tuple[Array, Array],
) -> dict[str, PoseSpace]:
    """The latent space and its linear rival of kp columns, with the poses q of all columns, (N, k).

    Args:
        pins: the fields of moving pins, (3n, l), and their coordinates in the poses, (N, l).
    """
    stiffness, (L, a) = reduced_rest_stiffness(scene, basis), pins
    kp, U = model.kp, basis.matrix
    wide, narrow = np.hstack([U, L]), np.hstack([U[:, :kp], L])
    identity = Decoder.identity(kp)
    return {
        "latent": PoseSpace(scene, wide, model.decoder, stiffness, model.encoder(q), displacement, a),
        "linear": PoseSpace(scene, narrow, identity, stiffness[:kp, :kp], q[:, :kp], displacement, a),
    }


def _warn(space: str, found: Selection, settings: CubatureSettings) -> None:
    if not found.fit.met:
        most = settings.max_points if space == "latent" else settings.linear_max_points
        click.echo(
            f"warning: the {space} cubature reached a relative error of {found.fit.best.training_error:.3f} with "
            f"{len(found.fit.best.points)} points, asked were {settings.tolerance:g} with at most {most}; "
            "it was written all the same",
            err=True,
        )


def _summary(space: str, stored: StoredCubature) -> str:
    assert stored.perturbed_errors is not None
    errors = stored.best.training_error, stored.heldout_errors[stored.chosen], stored.perturbed_errors[stored.chosen]
    words = "{} points, relative error {:.3f}, held out {:.3f}, perturbed {:.3f}"
    told = f"{space}: " + words.format(len(stored.best.points), *errors)
    if stored.virtual is not None:
        found = stored.virtual
        errors = found.cubature.training_error, found.heldout_error, found.perturbed_error
        told += "; " + words.format(f"{len(found.cubature.points)} virtual", *errors) + f", closure {found.closure:g}"
    return told
