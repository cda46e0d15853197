"""Energy, stress and tangent of every material at a few deformations, to which each implementation of them is held.

The compiled materials are the first implementation; their own tests compare them with the formulas. After a change of
one of them, or a new one, write the numbers anew: python -m tests.mechanics.material_vectors
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldsim.mechanics.materials import MATERIALS
from ldsim.mechanics.materials.kernels import energy_stress, tangent
from tests.helpers import random_rotation

Array = NDArray[np.float64]
FILE = Path(__file__).with_name("materials.json")
MU, LAM = 1.3e4, 4.1e4


def deformations() -> list[Array]:
    """At rest, next to rest, rotated and strained, and turned inside out."""
    rng = np.random.default_rng(5)
    strained = [np.eye(3) + size * rng.normal(size=(3, 3)) for size in (1e-3, 0.1, 0.25, 0.35, 0.35)]
    inverted = random_rotation(rng) @ np.diag([1.3, 0.8, -0.5]) @ random_rotation(rng)
    return [np.eye(3), *strained, random_rotation(rng) @ np.diag([1.6, 1.1, 0.6]), inverted]


def stress_change(U: Any, V: Any, D: Any, O: Any, dF: Array) -> Array:
    """dP of dF from the four results of `kernels.tangent`, (3, 3)."""
    u, v = np.reshape(U, (3, 3)), np.reshape(V, (3, 3))
    X = u.T @ dF @ v
    T = np.diag(np.array([[D[0], D[3], D[4]], [D[3], D[1], D[5]], [D[4], D[5], D[2]]]) @ np.diag(X))
    for pair, (i, j) in enumerate([(0, 1), (0, 2), (1, 2)]):
        T[i, j] = O[pair] * X[i, j] + O[3 + pair] * X[j, i]
        T[j, i] = O[pair] * X[j, i] + O[3 + pair] * X[i, j]
    turned: Array = u @ T @ v.T
    return turned


def computed(name: str, F: Array, dF: Array) -> dict[str, Any]:
    """What the compiled material gives: Ψ, P, and dP along dF without and with negative eigenvalues set to zero."""
    kind, flat = MATERIALS[name], tuple(F.ravel().tolist())
    density, P = energy_stress(kind, flat, MU, LAM)
    if np.isinf(density):
        return {"density": None}
    free, clamped = (stress_change(*tangent(kind, flat, MU, LAM, clamp), dF).ravel() for clamp in (False, True))
    return {"density": density, "stress": list(P), "change": free.tolist(), "clamped_change": clamped.tolist()}


def read() -> dict[str, list[dict[str, Any]]]:
    """For each material its cases: F and dF, (9,), and what `computed` makes of them; density None for infinite."""
    vectors: dict[str, list[dict[str, Any]]] = json.loads(FILE.read_text(encoding="utf-8"))
    return vectors


if __name__ == "__main__":
    rng = np.random.default_rng(6)
    pairs = [(F, rng.normal(size=(3, 3))) for F in deformations()]
    made = {
        name: [{"F": F.ravel().tolist(), "dF": dF.ravel().tolist()} | computed(name, F, dF) for F, dF in pairs]
        for name in MATERIALS
    }
    lines = [json.dumps(name) + ": [\n" + ",\n".join(map(json.dumps, cases)) + "\n]" for name, cases in made.items()]
    FILE.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
