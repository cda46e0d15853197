"""The static playground: the playground's page with the model inside, which simulates in the browser, with no server.

It steps by the C library (ldsim/runtime) as WebAssembly; library and models stand in it compressed, in base64. Nothing
is loaded from anywhere, so it works from a disk.
"""

from __future__ import annotations

import base64
import zlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ldsim.artefacts.snapshots import Recorded
from ldsim.export.arrays import default_pull
from ldsim.report.camera import first_look
from ldsim.report.replay import packed
from ldsim.report.runs import tests_first
from ldsim.report.schema import ROLE_NAMES
from ldsim.report.wording import counted
from ldsim.run import AUTO, Run
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
    """The page, with the latent space and a linear one: the one that simulate chose is shown first."""
    mesh, space = run.scene.mesh, run.space(AUTO)
    offered = ["latent", "linear" if space.name == "latent" else space.name]
    cells = f"{mesh.n_cells:,} {CELLS[mesh.cell_type]}"
    subtitle = f"{cells}, moved by {counted(space.r, 'number')} and {counted(len(space.rule.points), 'cubature point')}"
    radius, stiffness = default_pull(run)
    pull = {"radius": radius, "stiffness": stiffness}
    about = first_look(run.scene) | {"title": run.experiment, "subtitle": subtitle, "pull": pull}
    about |= {"spaces": offered, "space": space.name}
    # Bases in float32, for size.
    packed = {name: compressed(model_bytes(run.space(name), single=True)) for name in offered}
    return assembled(about | {"motions": _motions(run)}, packed)


def assembled(about: Mapping[str, object], packed: Mapping[str, str]) -> str:
    """The page around what it says of a solid and its models, compressed, with today's library, script and style."""
    library = packed.get("runtime")
    if library is None or inflated(library) != webassembly():  # the same is kept: another zlib gives other bytes
        packed = {**packed, "runtime": compressed(webassembly())}
    script = (
        f'<script type="application/json" id="about">{inlined(about)}</script>\n'
        f'<script type="application/json" id="model">{inlined(packed)}</script>\n'
        f"<script>{bundle('playground')}</script>"
    )
    return playground(f"<style>{playground_style()}</style>", script)


def compressed(data: bytes) -> str:
    """Bytes as text, for `inflated` of arrays.js.

    Words of four bytes are taken apart first: the first bytes of numbers of one kind, sign and exponent, are alike.
    """
    whole = len(data) // 4 * 4
    apart = np.frombuffer(data[:whole], np.uint8).reshape(-1, 4).T.tobytes() + data[whole:]
    return base64.b64encode(zlib.compress(apart, 9)).decode("ascii")


def inflated(text: str) -> bytes:
    """The bytes that `compressed` was given."""
    apart = zlib.decompress(base64.b64decode(text))
    whole = len(apart) // 4 * 4
    return np.frombuffer(apart[:whole], np.uint8).reshape(4, -1).T.tobytes() + apart[whole:]


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
