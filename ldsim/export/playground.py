"""The static playground: the playground's page with the model inside, which simulates in the browser, with no server.

The step is a port of ldsim/dynamics (web/src/stepping.js), and the model a safetensors file in base64. Nothing is
loaded from anywhere, so it works from a disk.
"""

from __future__ import annotations

import base64
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ldsim.export.arrays import model_arrays, safetensors
from ldsim.mechanics.materials import material_names
from ldsim.report.camera import first_look
from ldsim.run import Run
from ldsim.web import PAGE_MATERIALS, bundle, inlined, playground, playground_style

CELLS = {"tet4": "tetrahedra", "hex8": "hexahedra"}
# Kept in float32, for size: they decide what is drawn and held, not how the solid moves.
SINGLE = ("vertices", "basis", "latent/basis")


def write_playground(run: Run, path: Path) -> None:
    """Write the page; both reduced spaces go into it, the latent one is shown first.

    Raises:
        SceneError: the solid has a material that the page does not know.
    """
    material_names(np.unique(run.scene.material).tolist(), PAGE_MATERIALS, "the exported page")
    mesh, space = run.scene.mesh, run.space("latent")
    cells = f"{mesh.n_cells:,} {CELLS[mesh.cell_type]}"
    subtitle = f"{cells}, moved by {space.r} numbers and {len(space.rule.points)} cubature points"
    about = first_look(run.scene) | {"title": run.experiment, "subtitle": subtitle}
    script = (
        f'<script type="application/json" id="about">{inlined(about)}</script>\n'
        f'<script type="application/octet-stream" id="model">{packed_model(run)}</script>\n'
        f"<script>{bundle('playground')}</script>"
    )
    path.write_text(playground(f"<style>{playground_style()}</style>", script), encoding="utf-8")


def packed_model(run: Run) -> str:
    """The model's arrays as safetensors in base64."""
    arrays: dict[str, NDArray[np.generic]] = {
        name: values.astype(np.float32) if name in SINGLE else values for name, values in model_arrays(run).items()
    }
    return base64.b64encode(safetensors(arrays, {"experiment": run.experiment})).decode("ascii")
