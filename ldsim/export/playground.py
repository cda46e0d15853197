"""The static playground: one HTML page with the model inside that simulates in the browser, with no server.

The page is put together from the files in export/web (the step in JavaScript, a port of ldsim/dynamics, and the
controls) and those in evaluation/web that draw. The model is a safetensors file in base64. Nothing is loaded from
anywhere, so it works from a disk.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ldsim.export.arrays import model_arrays, safetensors
from ldsim.export.source import Source
from ldsim.report import scripts
from ldsim.report.camera import look_at_broadside, upright

# The step and what it needs, in the order in which later files use earlier ones; node runs these alone in the tests.
PHYSICS = (
    "tensors.js",
    "materials.js",
    "decoder.js",
    "potential.js",
    "stepping.js",
    "model.js",
    "surface.js",
    "solid.js",
)
PAGE = (*PHYSICS, "view.js", "page.js")
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
    page = _text("page.html").replace("{title}", escape(source.experiment)).replace("{style}", _text("page.css"))
    page = page.replace("{script}", script(PAGE)).replace("{about}", _inlined(about))
    path.write_text(page.replace("{model}", packed_model(source)), encoding="utf-8")


def packed_model(source: Source) -> str:
    """The model's arrays as safetensors in base64."""
    arrays: dict[str, NDArray[np.generic]] = {
        name: values.astype(np.float32) if name in SINGLE else values for name, values in model_arrays(source).items()
    }
    return base64.b64encode(safetensors(arrays, {"experiment": source.experiment})).decode("ascii")


def script(names: Sequence[str]) -> str:
    """The given files of export/web and evaluation/web, one after another; they share one scope."""
    return "\n".join(scripts.script([name]) if name in scripts.DRAWING else _text(name) for name in names)


def _text(name: str) -> str:
    return files("ldsim.export").joinpath("web", name).read_text(encoding="utf-8")


def _inlined(value: object) -> str:
    """JSON that may stand inside a script element."""
    return json.dumps(value).replace("<", "\\u003c")
