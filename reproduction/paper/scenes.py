"""The configurations that the experiments share: in full size those of configs/paper/, and quick ones."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import yaml

from reproduction.harness import CONFIGS

MESHES = "$LDSIM_DATA/meshes/"
RECORDINGS = "$LDSIM_DATA/interactions/"

Configuration = dict[str, Any]


def _configuration(
    experiment: str,
    mesh: Mapping[str, Any],
    motions: list[dict[str, Any]],
    train: Mapping[str, Any],
    k: int,
    cubature: Mapping[str, Any] | None = None,
) -> Configuration:
    return {
        "experiment": experiment,
        "mesh": dict(mesh),
        "snapshot": {"motions": motions},
        "pca": {"k": k},
        "train": {"kind": "autoencoder", **train},
        "cubature": dict(cubature or {}),
    }


def _at_full_size(name: str) -> Configuration:
    """The paper's model at the paper's settings."""
    content: Configuration = yaml.safe_load((CONFIGS / "paper" / f"{name}.yaml").read_text(encoding="utf-8"))
    return content


def _recorded(name: str, frames: int | None = None, role: str = "train") -> dict[str, Any]:
    """A motion of the authors' recordings."""
    motion: dict[str, Any] = {"name": name, "role": role, "recording": f"{RECORDINGS}{name}.csv"}
    return motion if frames is None else motion | {"frames": frames}


def _pulls(name: str, count: int, seed: int, reach: float, role: str = "train", **others: Any) -> dict[str, Any]:
    pulls = {"count": count, "seed": seed, "reach": reach, "frames": 30, "rest": 20} | others
    return {"name": name, "role": role, "pulls": pulls}


def _solid(youngs_modulus: float, pins: dict[str, Any], **others: Any) -> dict[str, Any]:
    return {"material": {"youngs_modulus": youngs_modulus}, "pins": [pins], **others}


def _slab(axis: str, thickness: float) -> dict[str, Any]:
    return {"slab": {"axis": axis, "at": "min", "thickness": thickness}}


QUICK_TRAINING = {"epochs": 400, "batch": 64, "equilibrium": {"weight": 3.0}}
QUICK_CUBATURE = {"poses": 120, "heldout_poses": 40}


def cross(quick: bool, columns: int | None = None) -> Configuration:
    """The X of the paper, or a procedural one; as another experiment with so many columns of the basis.

    The criterion of the largest error leaves fewer columns of ours than the paper's figures take.
    """
    if not quick:
        made = _at_full_size("x")
        return made if columns is None else made | {"experiment": f"paper-x-{columns}", "pca": {"k": columns}}
    mesh = _solid(4e4, _slab("y", 0.001), shape={"name": "cross", "resolution": 2})
    motions = [_pulls("pulls_1", 4, 1, 0.1), _pulls("pulls_2", 1, 2, 0.1, role="validation")]
    return _configuration("paper-cross-quick", mesh, motions, {"r": 6} | QUICK_TRAINING, 19, QUICK_CUBATURE)


def bar(quick: bool, youngs_modulus: float = 1e5) -> Configuration:
    """The beam of the paper, or a procedural one; another modulus makes another experiment."""
    suffix = "" if youngs_modulus == 1e5 else f"-{youngs_modulus:.0f}"
    if not quick:
        made = _at_full_size("beam")
        material = made["mesh"]["material"] | {"youngs_modulus": youngs_modulus}
        return made | {"experiment": f"{made['experiment']}{suffix}", "mesh": made["mesh"] | {"material": material}}
    mesh = _solid(youngs_modulus, _slab("x", 0.001), shape={"name": "beam", "resolution": 2})
    motions = [_pulls("pulls_1", 4, 1, 0.12), _pulls("pulls_2", 1, 2, 0.12, role="validation")]
    return _configuration(f"paper-bar{suffix}-quick", mesh, motions, {"r": 5} | QUICK_TRAINING, 20, QUICK_CUBATURE)


def coarse_bar(quick: bool) -> Configuration:
    """The coarse one of the public beams, or a procedural one, in a basis with UᵀU = I as full-space losses take it."""
    if quick:
        configuration = bar(True) | {"experiment": "paper-coarse-beam-quick"}
    else:
        mesh = _solid(8e4, _slab("x", 0.021), file=f"{MESHES}beam_3042.mesh")
        configuration = _configuration("coarse-beam", mesh, [_recorded("beam")], {}, 15)
    return configuration | {"pca": {"k": 15, "inner_product": "euclidean"}}


def elephant(quick: bool) -> Configuration:
    """The elephant of the paper, or its coarse relative and the first frames of the recording."""
    local = _recorded("local_effect", role="validation")
    if not quick:
        return _at_full_size("elephant")
    mesh = _solid(8e4, _slab("z", 0.021), file=f"{MESHES}elephant_2428.mesh")
    motions = [_recorded("elephant", 250), local]
    return _configuration("paper-elephant-quick", mesh, motions, {"r": 7} | QUICK_TRAINING, 28, QUICK_CUBATURE)


def armadillo(quick: bool) -> Configuration:
    """The finer of the two armadillos that are public, or the coarse one; pinned by the recording's ball."""
    ball = {"ball": {"centre": [0.0, 0.124, -0.1], "radius": 0.12}}
    if not quick:
        return _at_full_size("armadillo")
    mesh = _solid(6e3, ball, file=f"{MESHES}armadillo_3104.mesh")
    motions = [_recorded("armadillo", 250)]
    return _configuration("paper-armadillo-quick", mesh, motions, {"r": 12} | QUICK_TRAINING, 40, QUICK_CUBATURE)


def dragon(quick: bool) -> Configuration:
    """The dragon of Figure 11, or the coarse one and the first frames of the recording."""
    pins = _slab("y", 0.01)
    if not quick:
        return _at_full_size("dragon")
    mesh = _solid(1e5, pins, file=f"{MESHES}dragon_6216.mesh")
    return _configuration(
        "paper-dragon-quick", mesh, [_recorded("dragon", 200)], {"r": 11} | QUICK_TRAINING, 29, QUICK_CUBATURE
    )


def catapult(quick: bool) -> Configuration:
    """The catapult of Figure 10: stiff, light and stepped at 0.5 ms."""
    if not quick:
        return _at_full_size("catapult")
    mesh = _solid(1e7, _slab("y", 0.05), file=f"{MESHES}catapult_599.mesh", density=200, time_step=0.0005)
    motions = [_recorded("catapult", 431)]
    return _configuration("paper-catapult-quick", mesh, motions, {"r": 2} | QUICK_TRAINING, 12, QUICK_CUBATURE)
