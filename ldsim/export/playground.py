"""The static playground: the playground's page with the model inside, which simulates in the browser, with no server.

It steps by the C library (ldsim/runtime) as WebAssembly; library and models stand in it in base64. Nothing is loaded
from anywhere, so it works from a disk.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping
from pathlib import Path

from ldsim.artefacts.snapshots import Recorded
from ldsim.export.arrays import default_pull
from ldsim.report.camera import first_look
from ldsim.report.replay import packed
from ldsim.report.runs import tests_first
from ldsim.report.schema import ROLE_NAMES
from ldsim.run import REDUCED, Run
from ldsim.runtime import webassembly
from ldsim.runtime.model_file import model_bytes
from ldsim.web import bundle, inlined, playground, playground_style

CELLS = {"tet4": "tetrahedra", "hex8": "hexahedra"}
# What the page holds at once (MOST in local.js).
MOST_PULLS = 16


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
    # In base64; bases in float32, for size.
    models = {name: _text(model_bytes(run.space(name), single=True)) for name in REDUCED}
    return assembled(about | {"motions": _motions(run)}, models)


def assembled(about: Mapping[str, object], models: Mapping[str, str]) -> str:
    """The page around what it says of a solid and its models, with today's library, script and style."""
    script = (
        f'<script type="application/json" id="about">{inlined(about)}</script>\n'
        f'<script type="application/json" id="model">{inlined({**models, "runtime": _text(webassembly())})}</script>\n'
        f"<script>{bundle('playground')}</script>"
    )
    return playground(f"<style>{playground_style()}</style>", script)


def _text(data: bytes) -> str:
    return base64.b64encode(data).decode("ascii")


def _motions(run: Run) -> list[dict[str, object]]:
    """The motions that the page can play: none without snapshots, none that moves pins or holds too many places."""
    motions = tests_first(run) if run.path("snapshots").is_file() else {}
    return [
        _played(name, each)
        for name, each in motions.items()
        if not each.motion.supports
        and max(len(each.motion.active(frame)) for frame in range(each.motion.frames)) <= MOST_PULLS
    ]


def _played(name: str, recorded: Recorded) -> dict[str, object]:
    motion, held = recorded.motion, recorded.held
    drags = [
        {
            "start": drag.start,
            "held": held[i].tolist(),
            "stiffness": drag.stiffness,
            "targets": packed(drag.targets, "f4"),
        }
        for i, drag in enumerate(motion.drags)
        if i in held
    ]
    gravity = None if motion.gravity is None else motion.gravity.tolist()
    words = ROLE_NAMES[recorded.role]
    return {"name": name, "words": words, "frames": motion.frames, "drags": drags, "gravity": gravity}
