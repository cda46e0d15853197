"""The reduced model as named arrays: all that is needed to decode, to step and to draw it, in .npz or .safetensors."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ldsim.dynamics.reduced.stepper import reduced_mass, reduced_rest_stiffness
from ldsim.export.source import ReducedSpace, Source, surface_of
from ldsim.mechanics.scene import Scene

Array = NDArray[np.float64]
Arrays = dict[str, NDArray[np.generic]]

# A pull that suits a run without drags, in diagonals: how wide, and how far away it is as strong as the weight.
PULL_RADIUS, PULL_REACH = 0.03, 0.1
TYPES = {"f8": "F64", "f4": "F32", "i8": "I64", "i4": "I32", "i1": "I8", "u1": "U8"}


def model_arrays(source: Source) -> Arrays:
    """Every array of the reduced model, as docs/export.md lists them; float64 and int32, SI units."""
    scene = source.scene
    surface = surface_of(scene.mesh)
    pull = default_pull(source)
    arrays: Arrays = {
        "vertices": scene.mesh.vertices,
        "basis": source.basis,
        "surface_triangles": surface.vertices[surface.triangles],
        "movable": scene.movable.astype(np.uint8),
        "time_step": np.array([scene.time_step]),
        "gravity": scene.gravity,
        "pull_radius": np.array([pull[0]]),
        "pull_stiffness": np.array([pull[1]]),
    }
    for name, space in source.spaces.items():
        arrays |= {f"{name}/{key}": values for key, values in space_arrays(scene, space).items()}
    return arrays


def space_arrays(scene: Scene, space: ReducedSpace) -> Arrays:
    """One space: the decoder's layers, the cubature's strain maps and materials, M̃, K̃₀ and the unit loads."""
    layers, points, U = space.decoder.layers, space.cubature.points, space.U
    elements = scene.elements
    return {
        "sizes": layers.sizes.astype(np.int32),
        "weights": layers.weights,
        "biases": layers.biases,
        "rest": layers.rest,
        "skip": layers.skip,
        "activation": np.array([layers.activation], dtype=np.int32),
        "strain_maps": space.cubature.strain_maps(scene, U),
        "cubature_weights": np.ascontiguousarray(space.cubature.weights),
        "material": elements.kind[points].astype(np.int32),
        "mu": elements.mu[points],
        "lam": elements.lam[points],
        "mass": reduced_mass(scene, U),
        "rest_stiffness": reduced_rest_stiffness(scene, U),
        "unit_loads": unit_loads(scene, U),
        "load": U.T @ scene.force(np.zeros(3)).ravel(),
    }


def unit_loads(scene: Scene, U: Array) -> Array:
    """Uᵀ f of a gravity of 1 m/s² along each axis, (3, k) float64; Uᵀ f_ext is their sum times g, and the dead load."""
    loads: Array = np.einsum("n,nak->ak", scene.vertex_mass, U.reshape(scene.mesh.n_vertices, 3, -1))
    return loads


def default_pull(source: Source) -> tuple[float, float]:
    """Radius in m and stiffness in N/m of a pull: those of the run's first drag, if it has one."""
    for name in source.motions:
        for drag in source.recorded(name).motion.drags:
            return drag.radius, drag.stiffness
    diagonal = source.scene.mesh.diagonal
    return PULL_RADIUS * diagonal, 10.0 * float(source.scene.mass.sum()) / (PULL_REACH * diagonal)


def write_npz(source: Source, path: Path) -> None:
    """Write the model for NumPy; an array's name has a slash where it belongs to one space."""
    with path.open("wb") as stream:
        np.savez_compressed(stream, **model_arrays(source))  # type: ignore[arg-type]


def write_safetensors(source: Source, path: Path) -> None:
    """Write the model in the safetensors format."""
    path.write_bytes(safetensors(model_arrays(source), {"experiment": source.experiment, "generator": "ldsim"}))


def safetensors(arrays: Mapping[str, NDArray[np.generic]], notes: Mapping[str, str]) -> bytes:
    """A safetensors file: the header's length, the header as JSON, the arrays one after another (huggingface format).

    The widest types come first and the header is padded to eight bytes, so that every array is aligned.
    """
    header: dict[str, object] = {"__metadata__": dict(notes)}
    parts, offset = [], 0
    for name in sorted(arrays, key=lambda key: (-arrays[key].dtype.itemsize, key)):
        little = np.ascontiguousarray(arrays[name].astype(arrays[name].dtype.newbyteorder("<"), copy=False))
        header[name] = {
            "dtype": TYPES[little.dtype.str[1:]],
            "shape": list(little.shape),
            "data_offsets": [offset, offset + little.nbytes],
        }
        parts.append(little.tobytes())
        offset += little.nbytes
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)
    return b"".join([len(text).to_bytes(8, "little"), text, *parts])
