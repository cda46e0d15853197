"""The configuration that a mesh or surface file starts with, where it comes without one."""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np

from ldsim.artefacts.atomic import replacing
from ldsim.mechanics.loads import usual_grip
from ldsim.mechanics.scene import Scene
from ldsim.mesh.formats import read_mesh, read_surface
from ldsim.settings.experiment import Settings, settings_of

SURFACES = (".stl", ".obj", ".ply", ".off")
# Of the extent of the file along the axis that it is pinned on.
PINNED_SHARE = 0.05
# Tets of a surface: few for the hand, more for the model.
COARSE_CELLS, FINE_CELLS = 2000, 10_000
# How far the pulls of the held-out motion go, and the errors that PCA and the autoencoder may leave, in diagonals. How
# many numbers a motion needs is not known before: a fixed r was larger than the basis of the first one that was tried.
REACH, PCA_TOLERANCE, TRAIN_TOLERANCE = 0.2, 0.0005, 0.004


def is_surface(source: Path) -> bool:
    """Whether a file holds a surface, by its suffix."""
    return source.suffix.lower() in SURFACES


def starting_settings(
    source: Path, config: Path, scale: float, youngs_modulus: float, axis: str, recording: Path
) -> Settings:
    """A solid of the usual material, pinned at the low end of an axis, that learns from one recording.

    Args:
        config: where the configuration would lie; its paths are relative to that folder.

    Raises:
        MeshError: the file cannot be read.
    """
    surface = is_surface(source)
    vertices = (read_surface(source, scale) if surface else read_mesh(source, scale).mesh).vertices
    thickness = PINNED_SHARE * float(np.ptp(vertices[:, "xyz".index(axis)]))
    file = os.path.relpath(source, config.parent)
    content = {
        "experiment": re.sub(r"[^A-Za-z0-9_.-]+", "-", source.stem),
        "mesh": {
            **({"surface": {"file": file, "cells": FINE_CELLS}} if surface else {"file": file}),
            "scale": scale,
            "material": {"youngs_modulus": youngs_modulus},
            "pins": [{"slab": {"axis": axis, "at": "min", "thickness": float(f"{thickness:.3g}")}}],
            **({"gravity": [0.0, 0.0, -9.8]} if axis == "z" else {}),  # it stands on its low end
        },
        "snapshot": {
            "motions": [
                {"name": "by_hand", "role": "train", "recording": os.path.relpath(recording, config.parent)},
            ]
        },
        "cubature": {"poses": 200, "heldout_poses": 50},
    }
    return settings_of(content, str(source))


def write_configuration(path: Path, settings: Settings, scene: Scene) -> None:
    """Write a starting configuration, with random and synthetic pulls to learn from and a few others to judge it by.

    Raises:
        ArtefactError: it cannot be written.
    """
    stiffness, radius = usual_grip(scene)
    diagonal = scene.mesh.diagonal
    numbers = {"reach": REACH * diagonal, "stiffness": stiffness, "radius": radius}
    pulls = {"rest": 60} | {name: float(f"{value:.3g}") for name, value in numbers.items()}
    content = settings.model_dump(mode="json", exclude_unset=True)
    content["snapshot"]["motions"] += [
        {"name": "pulls", "role": "train", "pulls": {"count": 8, "seed": 2} | pulls},
        {"name": "others", "role": "heldout", "pulls": {"count": 4, "seed": 1} | pulls},
    ]
    for stage, share in (("pca", PCA_TOLERANCE), ("train", TRAIN_TOLERANCE)):
        content[stage] = {"tolerance_mm": float(f"{1e3 * share * diagonal:.3g}")}
    content["train"]["synthetic"] = {"count": 60, "seed": 3} | pulls
    with replacing(path) as temporary:
        temporary.write_text(settings_of(content, str(path)).dump(defaults=False), encoding="utf-8")
