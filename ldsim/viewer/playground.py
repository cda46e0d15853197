"""From a run, or a scene, to the server of its page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ldsim.errors import LdsimError
from ldsim.export.playground import CELLS
from ldsim.mechanics.scene import Scene
from ldsim.report.camera import first_look
from ldsim.report.runs import tests_first
from ldsim.report.schema import ROLE_NAMES
from ldsim.run import AUTO, SPACES, Run
from ldsim.simulator import Simulator, full_simulator, load
from ldsim.viewer.payload import solid_block
from ldsim.viewer.player import PlayedMotion, Player
from ldsim.viewer.recorder import Recorder
from ldsim.viewer.server import Server
from ldsim.viewer.session import Session

# The full space of a larger mesh steps too slowly to be pulled by hand.
FULL_VERTICES = 3000
# The longest that the page waits for one step of it: what is found by then is shown.
STEP_SECONDS = 0.25


def play_server(run: Path, spaces: Sequence[str], port: int, until_closed: bool) -> Server:
    """The page of a finished run, with some spaces side by side at first.

    Raises:
        ArtefactError: what the spaces need is missing or stale.
        LdsimError: the full space is asked for on a mesh that is too fine.
    """
    first = [load(run, space, seconds=STEP_SECONDS) for space in _named(run, spaces)]
    scene = first[0].scene
    coarse = scene.mesh.n_vertices <= FULL_VERTICES
    if "full" in spaces and not coarse:
        raise LdsimError(
            f"the full space is asked for on {scene.mesh.n_vertices} vertices; it is shown up to {FULL_VERTICES}, "
            "choose --space latent or linear"
        )
    for simulator in first:
        _warm(simulator)
    offered = [space for space in reversed(SPACES) if space != "full" or coarse]
    offered += [simulator.space.name for simulator in first if simulator.space.name not in offered]
    session = Session(lambda space: load(run, space, seconds=STEP_SECONDS), offered, first, _player(run))
    return Server(session, _solid(first, run.resolve().name, "play"), port, until_closed)


def _named(folder: Path, spaces: Sequence[str]) -> list[str]:
    """Each space once, by its own name: "auto" is one of the others."""
    if AUTO not in spaces:
        return list(dict.fromkeys(spaces))
    with Run.open(folder) as run:
        return list(dict.fromkeys(run.chosen if space == AUTO else space for space in spaces))


def _player(folder: Path) -> Player:
    """The motions of a run, those that nothing has seen first; without its snapshots there are none."""
    with Run.open(folder) as run:
        if not run.path("snapshots").is_file():
            return Player()
        motions = tests_first(run).items()
        return Player({name: PlayedMotion(each.motion, ROLE_NAMES[each.role], each.held) for name, each in motions})


def record_server(scene: Scene, title: str, recorder: Recorder, port: int, until_closed: bool) -> Server:
    """The page of a coarse scene in the full space, where grabs are recorded.

    Raises:
        LdsimError: the mesh is too fine to be pulled by hand.
    """
    if scene.mesh.n_vertices > FULL_VERTICES:
        raise LdsimError(
            f"the mesh has {scene.mesh.n_vertices} vertices; up to {FULL_VERTICES} can be recorded on by hand: give a "
            "coarser mesh of the same solid, with --mesh, --resolution or --cells (the motion is replayed on the fine "
            "one)"
        )
    simulator = full_simulator(scene, seconds=STEP_SECONDS)
    _warm(simulator)
    session = Session(lambda space: simulator, ["full"], [simulator], recorder)
    return Server(session, _solid([simulator], title, "record"), port, until_closed)


def _warm(simulator: Simulator) -> None:
    """A step, so that kernels are compiled before a page waits for them."""
    simulator.step()
    simulator.reset()


def _solid(simulators: Sequence[Simulator], title: str, mode: str) -> bytes:
    scene = simulators[0].scene
    mesh = scene.mesh
    header = {
        "title": title,
        "subtitle": f"{mesh.n_vertices:,} vertices, {mesh.n_cells:,} {CELLS[mesh.cell_type]}",
        "gravity": scene.gravity.tolist(),
        "mode": mode,
    }
    return solid_block(simulators[0], header | first_look(scene))
