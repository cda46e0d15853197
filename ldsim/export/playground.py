"""The static playground: the playground's page with the model inside, which simulates in the browser, with no server.

It steps by the C library (ldsim/runtime) as WebAssembly; library and models stand in it in base64. Nothing is loaded
from anywhere, so it works from a disk.
"""

from __future__ import annotations

import base64
from pathlib import Path

from ldsim.export.arrays import default_pull
from ldsim.report.camera import first_look
from ldsim.run import REDUCED, Run
from ldsim.runtime import webassembly
from ldsim.runtime.model_file import model_bytes
from ldsim.web import bundle, inlined, playground, playground_style

CELLS = {"tet4": "tetrahedra", "hex8": "hexahedra"}


def write_playground(run: Run, path: Path) -> None:
    """Write the page.

    Raises:
        SceneError: the solid has a material that the C library does not know.
    """
    path.write_text(playground_page(run), encoding="utf-8")


def playground_page(run: Run) -> str:
    """The page; both reduced spaces go into it, the latent one is shown first."""
    mesh, space = run.scene.mesh, run.space("latent")
    cells = f"{mesh.n_cells:,} {CELLS[mesh.cell_type]}"
    subtitle = f"{cells}, moved by {space.r} numbers and {len(space.rule.points)} cubature points"
    radius, stiffness = default_pull(run)
    pull = {"radius": radius, "stiffness": stiffness}
    about = first_look(run.scene) | {"title": run.experiment, "subtitle": subtitle, "pull": pull}
    script = (
        f'<script type="application/json" id="about">{inlined(about)}</script>\n'
        f'<script type="application/json" id="model">{inlined(packed(run))}</script>\n'
        f"<script>{bundle('playground')}</script>"
    )
    return playground(f"<style>{playground_style()}</style>", script)


def packed(run: Run) -> dict[str, str]:
    """The library and the models in base64; bases in float32, for size."""
    files = {"runtime": webassembly()}
    files |= {name: model_bytes(run.space(name), single=True) for name in REDUCED}
    return {name: base64.b64encode(data).decode("ascii") for name, data in files.items()}
