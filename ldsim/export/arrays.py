"""The reduced model as named arrays: all that is needed to decode, to step and to draw it, in .npz or .safetensors."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from safetensors.numpy import save

from ldsim.arrays import Array
from ldsim.dynamics.reduced.matrices import reduced_mass, reduced_rest_stiffness
from ldsim.mechanics.scene import Scene
from ldsim.mesh.surface import Surface
from ldsim.run import Run
from ldsim.space.basis import Basis
from ldsim.space.space import Space

Arrays = dict[str, NDArray[np.generic]]

# A pull that suits a run without drags, in diagonals: how wide, and how far away it is as strong as the weight.
PULL_RADIUS, PULL_REACH = 0.03, 0.1


def model_arrays(run: Run) -> Arrays:
    """Every array of the reduced model, as docs/guide/export.md lists them; float64 and int32, SI units."""
    scene = run.scene
    surface = Surface.of(scene.mesh)
    pull = default_pull(run)
    arrays: Arrays = {
        "vertices": scene.mesh.vertices,
        "basis": run.basis.matrix,
        "surface_triangles": surface.vertices[surface.triangles].astype(np.int32),
        "movable": scene.movable.astype(np.uint8),
        "time_step": np.array([scene.time_step]),
        "gravity": scene.gravity,
        "pull_radius": np.array([pull[0]]),
        "pull_stiffness": np.array([pull[1]]),
    }
    for name in ("latent", "linear"):
        arrays |= {f"{name}/{key}": values for key, values in space_arrays(run.space(name)).items()}
    if run.model.columns is not None:  # a condensed space has a basis of its own
        arrays["latent/basis"] = run.model.columns
    if run.model.squares is not None:
        arrays["latent/squares"] = run.model.squares
    return arrays


def space_arrays(space: Space) -> Arrays:
    """One space: the decoder's layers, the cubature's strain maps and materials, M̃, K̃₀ and the unit loads."""
    scene, basis, rule = space.scene, space.reduced_basis, space.rule
    layers, elements = space.decoder.layers, rule.elements(scene)
    return {
        "sizes": layers.sizes.astype(np.int32),
        "weights": layers.weights,
        "biases": layers.biases,
        "rest": layers.rest,
        "skip": layers.skip,
        "activation": np.array([layers.activation], dtype=np.int32),
        "strain_maps": rule.strain_maps(scene, basis.matrix),
        "cubature_weights": np.ascontiguousarray(rule.weights),
        "material": elements.kind.astype(np.int32),
        "mu": elements.mu,
        "lam": elements.lam,
        "mass": reduced_mass(scene, basis),
        "rest_stiffness": reduced_rest_stiffness(scene, basis),
        "unit_loads": unit_loads(scene, basis),
        "load": basis.matrix.T @ scene.force(np.zeros(3)).ravel(),
    }


def unit_loads(scene: Scene, basis: Basis) -> Array:
    """Uᵀ f of a gravity of 1 m/s² along each axis, (3, k) float64; Uᵀ f_ext is their sum times g, and the dead load."""
    loads: Array = np.einsum("n,nak->ak", scene.vertex_mass, basis.fields)
    return loads


def default_pull(run: Run) -> tuple[float, float]:
    """Radius in m and stiffness in N/m of a pull: those of the run's first drag, if it has one and is there still."""
    for name in run.snapshots.names if run.path("snapshots").is_file() else ():
        for drag in run.recorded(name).motion.drags:
            return drag.radius, drag.stiffness
    diagonal = run.scene.mesh.diagonal
    return PULL_RADIUS * diagonal, 10.0 * float(run.scene.mass.sum()) / (PULL_REACH * diagonal)


def write_npz(run: Run, path: Path) -> None:
    """Write the model for NumPy; an array's name has a slash where it belongs to one space."""
    with path.open("wb") as stream:
        np.savez_compressed(stream, **model_arrays(run))  # type: ignore[arg-type]


def write_safetensors(run: Run, path: Path) -> None:
    """Write the model in the safetensors format."""
    path.write_bytes(safetensors(model_arrays(run), {"experiment": run.experiment, "generator": "ldsim"}))


def safetensors(arrays: Mapping[str, NDArray[np.generic]], notes: Mapping[str, str]) -> bytes:
    """A safetensors file in memory; its arrays are aligned."""
    return save({name: np.ascontiguousarray(values) for name, values in arrays.items()}, metadata=dict(notes))
