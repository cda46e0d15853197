"""Hyperelastic materials: the one list of names from which their numbers and files follow.

A material is one file of this package, with the name that stands in settings. It gives two compiled functions,
`energy_stress(F, mu, lam)` → Ψ, P and `tangent(F, mu, lam, clamp)`; `isotropic.py` makes the second, or both, from Ψ
and its slopes. What runs them by number is in `kernels.py`. This file imports neither, so that settings can read it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Literal, get_args

from ldsim.errors import SceneError

# The place of a name is its number in scene.h5: a new one comes last, and none is moved or used again.
MaterialName = Literal["neo_hookean", "stable_neo_hookean", "st_venant_kirchhoff", "fixed_corotated", "linear"]

MATERIALS: dict[str, int] = {name: number for number, name in enumerate(get_args(MaterialName))}


def material_number(name: str) -> int:
    """The number of a material.

    Raises:
        SceneError: there is none of this name.
    """
    if name not in MATERIALS:
        raise SceneError(f"unknown material {name!r}; known are {', '.join(MATERIALS)}")
    return MATERIALS[name]


def material_names(
    numbers: Iterable[int], known: Collection[str] = tuple(MATERIALS), place: str = "ldsim"
) -> list[str]:
    """The names of materials, in the order of their numbers, each once.

    Args:
        known: the materials that a place has, such as another program that steps a reduced model.
        place: its name, for the message.

    Raises:
        SceneError: one of them is not known there; another is never put in its place.
    """
    names = dict(enumerate(MATERIALS))
    found = [names.get(number, f"number {number}") for number in sorted(set(numbers))]
    for name in found:
        if name not in known:
            raise SceneError(f"{place} does not know the material {name!r}; it knows {', '.join(known)}")
    return found
