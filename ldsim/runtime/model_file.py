"""The model file of the C library: a header of 256 bytes and arrays in a fixed order, little-endian.

docs/guide/runtime.md says what each byte is; `find_arrays` of ldsim.c reads them in the same order.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ldsim.arrays import Array
from ldsim.cubature.rule import strain_maps
from ldsim.dynamics.reduced.moving_pins import MovingPins
from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.potential import Reduced
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.errors import ExportError
from ldsim.mechanics.grabs import usual_grip
from ldsim.mechanics.materials import material_names
from ldsim.mechanics.scene import Scene
from ldsim.mesh.surface import Surface
from ldsim.space.anchors import Anchors
from ldsim.space.compliance import Compliance
from ldsim.space.decoder import decode
from ldsim.space.space import Space

# In the order of ldsim.c; another one is refused by its name.
KNOWN = ("neo_hookean", "stable_neo_hookean", "st_venant_kirchhoff", "fixed_corotated", "linear")
MAGIC, VERSION, HEADER = b"LDSIM\r\n\x1a", 3, 256
MAX_LAYERS = 8
Arrays = dict[str, NDArray[Any]]


class Pieces(NamedTuple):
    """What a file is made of: counts and numbers of the header, and the arrays, each in the order of the file."""

    counts: list[int]
    numbers: list[float]
    arrays: Arrays


def portable(space: Space) -> tuple[Space, str]:
    """A space as the library has it, and in words by how much it is another one; no words where it is the same."""
    if space.compliance is None:
        return space, ""
    compliance = space.compliance.anchored()
    assert compliance.anchors is not None
    dent = compliance.relaxation.residual if space.turns else compliance.local
    middle, most = compliance.anchors.error(compliance.scene, compliance.local, dent)
    words = f"; how far a grab sinks in is off by {middle:.1%}, at most {most:.1%}, of that"
    return replace(space, compliance=compliance), words if most > 1e-6 else ""


def model_bytes(space: Space, options: ReducedOptions = ReducedOptions(), *, single: bool = False) -> bytes:
    """A reduced space as the C library loads it.

    Args:
        options: of the minimiser; the library has BFGS around the present tangent alone, Python's default.
        single: keep the basis, and of a condensed space its compliance, in float32, for size. What is drawn and held
            comes to seven digits then; a step is otherwise the same.

    Raises:
        ExportError: the library does not have what is asked for.
        SceneError: it does not have a material.
    """
    if options.method != "bfgs" or not options.current:
        raise ExportError(
            f"the C library steps by method bfgs with current: true; got {options.method}, current: {options.current}"
        )
    if space.basis is None:
        raise ExportError(f"the C library steps reduced spaces alone; got the {space.name} space")
    space = space.by_material()
    parts = pieces(space, options, single)
    body = b"".join(_padded(array.tobytes()) for array in parts.arrays.values())
    header = np.array(parts.counts, dtype="<u4").tobytes().ljust(HEADER - 40 - 8 * len(parts.numbers), b"\0")
    rest = header + np.array(parts.numbers, dtype="<f8").tobytes() + body
    size = np.array([40 + len(rest)], dtype="<u8").tobytes()
    return MAGIC + np.array([VERSION, HEADER], dtype="<u4").tobytes() + size + checksum(rest) + rest


def checksum(data: bytes) -> bytes:
    """Two sums of 64-bit words, of which the second tells their order (Fletcher 1982); 16 bytes."""
    words = np.frombuffer(data, dtype="<u8")
    second = (words * np.arange(len(words), 0, -1, dtype=np.uint64)).sum(dtype=np.uint64)
    return np.array([words.sum(dtype=np.uint64), second], dtype="<u8").tobytes()


def _padded(data: bytes) -> bytes:
    """Every array begins at a multiple of eight bytes."""
    return data + b"\0" * (-len(data) % 8)


def pieces(space: Space, options: ReducedOptions, single: bool) -> Pieces:
    """Of a space whose points are sorted by material."""
    compiled = ReducedStepper(space, options).compiled()[0]
    layers, novelty, condensed = compiled.layers, space.novelty, space.compliance is not None
    anchors = None if space.compliance is None else space.compliance.anchored().anchors
    moving = space.lifting is not None and space.lifting.count > 0
    _refuse(space, compiled, moving)
    pins = MovingPins.of(space) if moving else None
    arrays = _arrays(space, compiled, pins, anchors, single)
    widths, modes = [int(width) for width in layers.sizes[1:]], len(space.squares)
    if folded := _is_folded(space, compiled):
        widths, arrays = widths[:-1], _folded(space, arrays)
    elif modes:
        arrays |= _of_features(np.eye(space.decoder.k), arrays, modes)
    anchored = (0, 0) if anchors is None else (len(anchors.matrix) // 3, anchors.near.shape[1])
    counts = [space.scene.mesh.n_vertices, len(arrays["triangles"]), space.r, len(arrays["load"]) - modes]
    counts += [len(widths), *widths, *[0] * (MAX_LAYERS - len(widths)), int(layers.activation), int(folded)]
    counts += [int(layers.skip.size > 0), len(arrays["maps"]), len(compiled.weights), int(arrays["inertia"].ndim > 1)]
    counts += [0 if pins is None else len(pins.lifting.supports), 0 if novelty is None else len(novelty.landmarks)]
    counts += [int(condensed), *anchored, *(space.scene.mesh.cells.shape if condensed else (0, 0))]
    counts += [4 if single else 8, options.max_iterations, modes]
    return Pieces(counts, _numbers(space, options), arrays)


def _refuse(space: Space, compiled: Reduced, moving: bool) -> None:
    """What the library does not have."""
    material_names(compiled.kind.tolist(), KNOWN, "the C library")
    layers = len(compiled.layers.sizes) - 1
    if layers > MAX_LAYERS:
        raise ExportError(f"the decoder has {layers} layers; the C library takes at most {MAX_LAYERS}")
    if moving and space.compliance is not None:
        raise ExportError("the C library has no condensed model whose pins move")


def _numbers(space: Space, options: ReducedOptions) -> list[float]:
    scene, novelty = space.scene, space.novelty
    reach, threshold = (0.0, 0.0) if novelty is None else (novelty.reach, novelty.threshold)
    numbers = [scene.time_step, *scene.gravity, options.stop(float(scene.vertex_mass.sum())), scene.mass.sum()]
    return [float(x) for x in (*numbers, scene.mesh.diagonal, *usual_grip(scene), reach, threshold, space.turns)]


def _arrays(space: Space, compiled: Reduced, pins: MovingPins | None, anchors: Anchors | None, single: bool) -> Arrays:
    """In the order of the file, of coordinates that are not folded into features yet."""
    scene, basis, surface, none = space.scene, space.reduced_basis, Surface.of(space.scene.mesh), np.empty(0)
    size = "<f4" if single else "<f8"
    return {
        "rest": _f8(scene.mesh.vertices),
        **dict(_network(space)),
        **_reduced(compiled),
        "load": _f8(basis.matrix.T @ scene.force(np.zeros(3)).ravel()),
        "unit_weight": _f8(np.einsum("nik,n->ki", basis.fields, scene.vertex_mass)),
        **_moving_pins(pins, scene, space),
        "landmarks": _f8(none if space.novelty is None else space.novelty.landmarks),
        "mode_rows": none,
        "squares": _f8(space.squares),
        **_residual(space.compliance, scene),
        "basis": basis.matrix.astype(size),
        "anchored": _lower(anchors).astype(size),
        "triangles": _u4(surface.vertices[surface.triangles]),
        "movable": _u4(scene.movable),
        "kind": _u4(compiled.kind),
        "near": _u4(none if anchors is None else anchors.near),
        "cells": _u4(none if anchors is None else scene.mesh.cells),
    }


def _network(space: Space) -> Iterator[tuple[str, NDArray[np.generic]]]:
    decoder = space.decoder
    for i, (weights, biases) in enumerate(zip(decoder.weights, decoder.biases, strict=True)):
        yield from ((f"weights_{i}", _f8(weights)), (f"biases_{i}", _f8(biases)))
    yield from (("at_zero", _f8(decoder.layers.rest)), ("skip", _f8(decoder.layers.skip)))


def _is_folded(space: Space, compiled: Reduced) -> bool:
    """Whether a step has fewer products where the last layer is multiplied into all that reads its outputs."""
    decoder = space.decoder
    if len(decoder.weights) < 2:
        return False
    r, k, (c, _, mapped) = decoder.r, decoder.k, compiled.G.shape
    w, skipped = len(decoder.weights[-1]), 0 if decoder.skip is None else r
    if w + skipped < r:  # a model has as many features as coordinates at least
        return False
    here = w * k + skipped * k + 9 * c * mapped + (len(compiled.inertia) * k if len(compiled.inertia) > 1 else 0)
    there = 9 * c * (w + skipped) + (w + skipped) ** 2 / 2
    return bool(there < here)


def _folded(space: Space, arrays: Arrays) -> Arrays:
    """The arrays for the features (a, z), with a what the last hidden layer says, z only where there is a skip.

    With the weights W of the last layer q = N(z) − N(0) + Aᵀz is Wᵀ (a − a(0)) + Aᵀz, for its biases cancel: P times
    the features. What is linear in q follows.
    """
    decoder, last = space.decoder, len(space.decoder.weights) - 1
    W, skip, hidden = decoder.weights[last], decoder.skip, np.empty(decoder.hidden_size)
    decode(decoder.layers, np.zeros(decoder.r), hidden, np.empty(decoder.k))
    P = W.T if skip is None else np.concatenate([W.T, skip.T], axis=1)
    folded = _of_features(P, arrays, len(space.squares))
    folded |= {
        "at_zero": _f8(hidden[-len(W) :]),
        "skip": _f8(np.empty(0) if skip is None else np.eye(decoder.r, P.shape[1], len(W))),
        "maps": _f8(np.einsum("jec,jf->fec", arrays["maps"], P[: len(arrays["maps"])])),
    }
    gone = (f"weights_{last}", f"biases_{last}")
    return {name: folded.get(name, array) for name, array in arrays.items() if name not in gone}


def _of_features(P: Array, arrays: Arrays, modes: int) -> Arrays:
    """What is linear in q = P f, for features f and behind them the last coordinates themselves, which are modes."""
    own = len(P) - modes
    Q, inertia, basis = P[:own], arrays["inertia"], arrays["basis"]
    found: Arrays = {
        "inertia": _f8(Q.T @ (inertia[:own, :own] @ Q if inertia.ndim > 1 else inertia[:own, None] * Q)),
        "basis": np.concatenate([basis[:, :own] @ Q, basis[:, own:]], axis=1).astype(basis.dtype),
        "mode_rows": _f8(P[own:]),
    }
    for name in ("load", "unit_weight", "lifted_inertia"):
        values = arrays[name]
        found[name] = _f8(np.concatenate([Q.T @ values[:own], values[own:]])) if values.size else values
    return found


def _reduced(compiled: Reduced) -> Arrays:
    """Strain maps by coordinate, (j, 9, c): a strain is then a sum of rows that lie in one piece."""
    maps = np.ascontiguousarray(compiled.G.transpose(2, 1, 0))
    inertia = compiled.inertia if len(compiled.inertia) > 1 else compiled.inertia[0]
    numbers = {"weights": compiled.weights, "mu": compiled.mu, "lam": compiled.lam, "inertia": inertia}
    return {"maps": _f8(maps), **{name: _f8(values) for name, values in numbers.items()}}


def _moving_pins(pins: MovingPins | None, scene: Scene, space: Space) -> Arrays:
    empty = np.empty(0)
    if pins is None:
        return {"lifting": empty, "lifted_strain": empty, "lifted_inertia": empty}
    # (9, c, l): as the strains lie
    strain = strain_maps(scene, pins.lifting.fields, space.rule.points).transpose(1, 0, 2)
    return {"lifting": _f8(pins.fields), "lifted_strain": _f8(strain), "lifted_inertia": _f8(pins.inertia)}


def _residual(compliance: Compliance | None, scene: Scene) -> Arrays:
    """What weight moves beside the coordinates of a condensed space, and how vertices hang on its anchors."""
    if compliance is None:
        return {name: np.empty(0) for name in ("sag", "vertex_mass", "share")}
    anchors = compliance.anchored().anchors
    assert anchors is not None
    dead, weight = compliance.sags(local=True)
    sag = np.concatenate([dead[:, :, None], weight], axis=2)
    return {"sag": _f8(sag), "vertex_mass": _f8(scene.vertex_mass), "share": _f8(anchors.weights)}


def _lower(anchors: Anchors | None) -> Array:
    """A row by row up to its diagonal."""
    return np.empty(0) if anchors is None else anchors.matrix[np.tril_indices(len(anchors.matrix))]


def _f8(values: Array) -> NDArray[np.generic]:
    return np.ascontiguousarray(values, dtype="<f8")


def _u4(values: NDArray[np.generic]) -> NDArray[np.generic]:
    return np.ascontiguousarray(values.astype("<u4"))
