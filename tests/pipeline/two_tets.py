"""A run of two tets whose stages take no time: its mesh and its motion are files, and no other process is started."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ldsim.artefacts.partial import Lease
from ldsim.artefacts.store import file_hash
from ldsim.dynamics.full.options import FullOptions
from ldsim.mechanics.motion import Motion
from ldsim.pipeline.ensemble import run_motion
from ldsim.pipeline.mesh import mesh
from ldsim.pipeline.options import MeshOptions, SnapshotOptions
from ldsim.run import Run
from tests.cli.test_bad_mesh import GOOD

MESH, RECORDING = "two.mesh", "still.csv"
SCENE = MeshOptions.model_validate(
    {"file": MESH, "material": {"youngs_modulus": 1e5}, "pins": [{"vertices": [0, 1, 2]}], "gravity": (0, 0, -1)}
)
ROWS = """# spring_stiffness_n_per_m: 30
# grab_radius_m: 0.03
is_dragging,target_x,target_y,target_z,grabbed_x,grabbed_y,grabbed_z
0,0,0,0,0,0,0
0,0,0,0,0,0,0
"""


def made(folder: Path) -> Run:
    """The run, with its scene; the files that its options name lie in the folder."""
    (folder / MESH).write_text(GOOD, encoding="utf-8")
    (folder / RECORDING).write_text(ROWS, encoding="utf-8")
    run = Run(folder / "run")
    mesh(run, SCENE, base=folder)
    return run


def motions(**others: object) -> SnapshotOptions:
    return SnapshotOptions.model_validate({"motions": [{"name": "still", "recording": RECORDING}], **others})


def run_here(
    scene_path: Path, folder: Path, motions: Sequence[Motion], options: FullOptions, *_: object, **__: object
) -> dict[str, str]:
    """In the place of `run_motions`, in this process."""
    lease = Lease.taken(folder)
    for motion in motions:
        run_motion(scene_path, lease, motion, options, file_hash(scene_path))
    lease.given_back()
    return {}
