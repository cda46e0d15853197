"""The static playground: one HTML page with the model inside that simulates in the browser, with no server.

The page holds the bundle of web/src/exported.js, in which the step is a port of ldsim/dynamics, and the model as a
safetensors file in base64. Nothing is loaded from anywhere, so it works from a disk.
"""

from __future__ import annotations

import base64
import re
from html import escape
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ldsim.export.arrays import model_arrays, safetensors
from ldsim.export.source import Source
from ldsim.report.camera import look_at_broadside, upright
from ldsim.web import bundle, inlined, page

# Kept in float32, for size: they decide what is drawn and held, not how the solid moves.
SINGLE = ("vertices", "basis")


def write_playground(source: Source, path: Path) -> None:
    """Write the page; both reduced spaces go into it, the latent one is shown first."""
    scene = source.scene
    turn = upright(scene.gravity)
    rest = scene.mesh.vertices @ turn.T
    view = look_at_broadside(rest, rest)
    about = {
        "experiment": source.experiment,
        "cells": scene.mesh.n_cells,
        "vertices": scene.mesh.n_vertices,
        "cell_type": scene.mesh.cell_type,
        "azimuth": view.azimuth,
        "elevation": view.elevation,
        "up": turn.ravel().tolist(),
    }
    parts = {
        "title": escape(source.experiment),
        "style": page("exported.css"),
        "script": bundle("exported"),
        "about": inlined(about),
        "model": packed_model(source),
    }
    # One pass: what is put in may hold braces of its own.
    text = re.sub(r"\{(\w+)\}", lambda found: parts[found[1]], page("exported.html"))
    path.write_text(text, encoding="utf-8")


def packed_model(source: Source) -> str:
    """The model's arrays as safetensors in base64."""
    arrays: dict[str, NDArray[np.generic]] = {
        name: values.astype(np.float32) if name in SINGLE else values for name, values in model_arrays(source).items()
    }
    return base64.b64encode(safetensors(arrays, {"experiment": source.experiment})).decode("ascii")
