"""The configurations that the experiments share, full and quick; the full ones are those of configs/."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

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
        "train": dict(train),
        "cubature": dict(cubature or {}),
    }


def _recorded(name: str, frames: int | None = None, role: str = "train") -> dict[str, Any]:
    """A motion of the authors' recordings."""
    motion: dict[str, Any] = {"name": name, "role": role, "recording": f"{RECORDINGS}{name}.csv"}
    return motion if frames is None else motion | {"frames": frames}


def _pulls(name: str, count: int, seed: int, reach: float, role: str = "train", **others: Any) -> dict[str, Any]:
    pulls = {"count": count, "seed": seed, "reach": reach, "frames": 30, "rest": 20} | others
    return {"name": name, "role": role, "pulls": pulls}


def _solid(youngs_modulus: float, pins: dict[str, Any], **others: Any) -> dict[str, Any]:
    return {"material": {"youngs_modulus": youngs_modulus}, "pins": [pins], **others}


def _slab(axis: str, thickness: float, at: str = "min") -> dict[str, Any]:
    return {"slab": {"axis": axis, "at": at, "thickness": thickness}}


SYNTHETIC = {"synthetic": {"count": 400, "seed": 11, "reach": 0.55, "frames": 25, "rest": 40}}
QUICK_TRAINING = {"epochs": 400, "batch": 64, "equilibrium": {"weight": 3.0}}
QUICK_CUBATURE = {"poses": 120, "heldout_poses": 40}


def cross(quick: bool) -> Configuration:
    """The X of the paper, or a procedural one."""
    if not quick:
        mesh = _solid(6e4, _slab("y", 0.001), file=f"{MESHES}x_29686.mesh")
        motions, training = (
            [_recorded("x_1"), _recorded("x_2", role="validation")],
            {"r": 12, "hidden": [64, 64], "epochs": 40},
        )
        made = _configuration("x", mesh, motions, training, 60, {"tolerance": 0.03})
        return made | {"pca": made["pca"] | SYNTHETIC}
    mesh = _solid(4e4, _slab("y", 0.001), shape={"name": "cross", "resolution": 2})
    motions = [_pulls("pulls_1", 4, 1, 0.1), _pulls("pulls_2", 1, 2, 0.1, role="validation")]
    return _configuration("paper-cross", mesh, motions, {"r": 6} | QUICK_TRAINING, 19, QUICK_CUBATURE)


def bar(quick: bool, youngs_modulus: float = 1e5) -> Configuration:
    """The beam of the paper, or a procedural one; another modulus makes another experiment."""
    suffix = "" if youngs_modulus == 1e5 else f"-{youngs_modulus:.0f}"
    if not quick:
        mesh = _solid(youngs_modulus, _slab("x", 0.021), file=f"{MESHES}beam_45151.mesh")
        pulls = _pulls("pulls", 4, 1, 0.1, role="validation", stiffness=30, radius=0.03, frames=40, rest=40)
        return _configuration(f"beam{suffix}", mesh, [_recorded("beam"), pulls], {"r": 10}, 60)
    mesh = _solid(youngs_modulus, _slab("x", 0.001), shape={"name": "beam", "resolution": 2})
    motions = [_pulls("pulls_1", 4, 1, 0.12), _pulls("pulls_2", 1, 2, 0.12, role="validation")]
    return _configuration(f"paper-bar{suffix}", mesh, motions, {"r": 5} | QUICK_TRAINING, 20, QUICK_CUBATURE)


def coarse_bar(quick: bool) -> Configuration:
    """The coarse one of the public beams, or a procedural one, in a basis with UᵀU = I as full-space losses take it."""
    if quick:
        configuration = bar(True) | {"experiment": "paper-coarse-beam"}
    else:
        mesh = _solid(8e4, _slab("x", 0.021), file=f"{MESHES}beam_3042.mesh")
        configuration = _configuration("coarse-beam", mesh, [_recorded("beam")], {}, 15)
    return configuration | {"pca": {"k": 15, "inner_product": "euclidean"}}


def elephant(quick: bool) -> Configuration:
    """The elephant of the paper, or its coarse relative and the first frames of the recording."""
    local = _recorded("local_effect", role="validation")
    if not quick:
        mesh = _solid(1e5, _slab("z", 0.021), file=f"{MESHES}elephant_61699.mesh")
        return _configuration("elephant", mesh, [_recorded("elephant"), local], {"r": 7}, 60)
    mesh = _solid(8e4, _slab("z", 0.021), file=f"{MESHES}elephant_2428.mesh")
    motions = [_recorded("elephant", 250), local]
    return _configuration("paper-elephant", mesh, motions, {"r": 7} | QUICK_TRAINING, 28, QUICK_CUBATURE)


def armadillo(quick: bool) -> Configuration:
    """The finer of the two armadillos that are public, or the coarse one; pinned by the recording's ball."""
    ball = {"ball": {"centre": [0.0, 0.124, -0.1], "radius": 0.12}}
    if not quick:
        mesh = _solid(1e4, ball, file=f"{MESHES}armadillo_52897.mesh")
        return _configuration("armadillo", mesh, [_recorded("armadillo")], {"r": 20}, 62)
    mesh = _solid(6e3, ball, file=f"{MESHES}armadillo_3104.mesh")
    motions = [_recorded("armadillo", 250)]
    return _configuration("paper-armadillo", mesh, motions, {"r": 12} | QUICK_TRAINING, 40, QUICK_CUBATURE)


def dragon(quick: bool) -> Configuration:
    """The dragon of Figure 11, or the coarse one and the first frames of the recording."""
    pins = _slab("y", 0.01)
    if not quick:
        mesh = _solid(1e5, pins, file=f"{MESHES}dragon_56822.mesh")
        return _configuration("dragon", mesh, [_recorded("dragon")], {"r": 11}, 29)
    mesh = _solid(1e5, pins, file=f"{MESHES}dragon_6216.mesh")
    return _configuration(
        "paper-dragon", mesh, [_recorded("dragon", 200)], {"r": 11} | QUICK_TRAINING, 29, QUICK_CUBATURE
    )


def catapult(quick: bool) -> Configuration:
    """The catapult of Figure 10: stiff, light and stepped at 0.5 ms."""
    size, modulus = (599, 1e7) if quick else (13802, 1.7e7)
    mesh = _solid(modulus, _slab("y", 0.05), file=f"{MESHES}catapult_{size}.mesh", density=200, time_step=0.0005)
    name = "paper-catapult" if quick else "catapult"
    training = {"r": 2} | (QUICK_TRAINING if quick else {})
    return _configuration(name, mesh, [_recorded("catapult", CATAPULT_FRAMES)], training, 12, QUICK_CUBATURE)


CATAPULT_FRAMES = 431
