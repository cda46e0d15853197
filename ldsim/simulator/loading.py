"""From the artefacts of a run to a simulator."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ldsim.artefacts.records import (
    StoredCubature,
    StoredModel,
    read_basis,
    read_cubature,
    read_model,
    read_scene,
)
from ldsim.artefacts.store import check_inputs
from ldsim.dynamics.reduced.stepper import ReducedState, ReducedStepper
from ldsim.dynamics.spaces import FullDynamics, ReducedDynamics
from ldsim.errors import ArtefactError
from ldsim.mechanics.scene import Scene
from ldsim.simulator.simulator import Simulator
from ldsim.space.decoder import Decoder
from ldsim.space.novelty import Novelty
from ldsim.space.pca import Pca

Array = NDArray[np.float64]

SPACES = ("latent", "linear", "full")

# Where a reduced step stops unless told: at a gradient of this share of the solid's weight on earth. A tighter stop
# takes half as long again and moves no digit of the online error that one could see (docs/measurements.md).
SHARE_OF_WEIGHT = 1e-4
EARTH = 9.8


def load(
    run: str | Path, space: str = "latent", *, points: int | None = None, tolerance: float | None = None
) -> Simulator:
    """A simulator of a finished run.

    Args:
        run: the folder of the run, such as runs/x.
        space: "latent", "linear" or "full"; the full space needs only scene.h5.
        points: use the largest cubature of at most so many points of the mesh instead of the one that was chosen.
        tolerance: stop at ‖∇E‖ ≤ tolerance · max(‖x‖, 1), N; by default 10⁻⁴ of the solid's weight in a
            reduced space, 10⁻⁶ N in the full one.

    Raises:
        ArtefactError: an artefact is missing, damaged, or was made from other files than those beside it.
    """
    if space not in SPACES:
        raise ArtefactError(f"space is {space!r}; known are {', '.join(SPACES)}")
    folder = Path(run)
    if not folder.is_dir():
        raise ArtefactError(f"{folder} is not the folder of a run; give one such as runs/demo, made by `make`")
    scene, _ = read_scene(folder / "scene.h5")
    if space == "full":
        return full_simulator(scene, 1e-6 if tolerance is None else tolerance)
    basis, model, cubature = _reduced_parts(folder, scene)
    chosen = cubature[space].stepped if points is None else cubature[space].at_most(points)
    U, decoder, novelty = basis.basis.matrix, model.decoder, None
    if space == "linear":
        U, decoder = np.ascontiguousarray(U[:, : model.kp]), Decoder.identity(model.kp)
    elif model.novelty is not None:
        novelty = _novelty(model.novelty)
    stopping = stop_of(scene) if tolerance is None else tolerance
    stepper = ReducedStepper(scene, U, decoder, chosen, tolerance=stopping)
    dynamics = ReducedDynamics(scene, stepper)
    return Simulator(scene, dynamics, space, basis=U, points=chosen.points, novelty=novelty)


def stop_of(scene: Scene) -> float:
    """Where a reduced step stops unless told: at 10⁻⁴ of the solid's weight, N."""
    return SHARE_OF_WEIGHT * EARTH * float(scene.vertex_mass.sum())


def full_simulator(scene: Scene, tolerance: float = 1e-6) -> Simulator:
    """A simulator of a scene in the full space, every vertex free."""
    return Simulator(scene, FullDynamics(scene, tolerance), "full")


def _novelty(novelty: Novelty) -> Callable[[ReducedState], float]:
    """The score of a state over the one from which on to warn."""
    return lambda state: float(novelty(state.z[None])[0]) / novelty.threshold


def _reduced_parts(folder: Path, scene: Scene) -> tuple[Pca, StoredModel, dict[str, StoredCubature]]:
    """Basis, model and cubature of a run, checked to belong together."""
    paths = {kind: folder / f"{kind}.h5" for kind in ("scene", "basis", "model", "cubature")}
    basis, basis_header = read_basis(paths["basis"], scene)
    model, model_header = read_model(paths["model"])
    cubature, cubature_header = read_cubature(paths["cubature"])
    for header, inputs in (
        (basis_header, ("scene",)),
        (model_header, ("basis",)),
        (cubature_header, ("scene", "basis", "model")),
    ):
        check_inputs(paths[header.kind], header, {name: paths[name] for name in inputs})
    return basis, model, cubature
