"""A run that went through all stages, as the report reads it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from ldsim.artefacts.records import StoredCubature, StoredModel
from ldsim.artefacts.snapshots import Recorded, Snapshots
from ldsim.artefacts.store import Header
from ldsim.dynamics.trajectory import Trajectory
from ldsim.mechanics.scene import Scene
from ldsim.space.lifting import Lifting
from ldsim.space.pca import Pca

REDUCED = ("linear", "latent")


@dataclass(frozen=True, eq=False)
class FinishedRun:
    """The artefacts of one experiment, which belong together.

    Attributes:
        snapshots: open for reading.
        trajectories: space → motion → what was run.
        headers: kind → header of each artefact.
    """

    experiment: str
    scene: Scene
    snapshots: Snapshots
    basis: Pca
    model: StoredModel
    cubature: Mapping[str, StoredCubature]
    trajectories: Mapping[str, Mapping[str, Trajectory]]
    headers: Mapping[str, Header]

    @cached_property
    def recorded(self) -> dict[str, Recorded]:
        """Every motion of the snapshots by name, in their order."""
        return {name: self.snapshots.recorded(name) for name in self.snapshots.names}

    @cached_property
    def lifting(self) -> Lifting:
        """Of every pin that moves in one of the motions; a frame of a reduced run is U q + L a."""
        return Lifting.of(self.scene, [recorded.motion for recorded in self.recorded.values()])

    def runs(self, space: str) -> dict[str, Trajectory]:
        """What was run in a space, in the snapshots' order of motions."""
        done = self.trajectories.get(space, {})
        return {name: done[name] for name in self.recorded if name in done}

    def reduced_runs(self, motion: str) -> dict[str, Trajectory]:
        """Reduced space → its run of a motion, where there is one."""
        return {space: self.runs(space)[motion] for space in REDUCED if motion in self.runs(space)}

    @property
    def marks(self) -> dict[str, int]:
        """The dimensions that figures point out."""
        return {"r": self.model.decoder.r, "kp": self.model.kp, "k": self.basis.basis.k}

    def title(self, space: str) -> str:
        """A space with the numbers that it moves by."""
        marks = self.marks
        words = {"linear": f"linear, {marks['kp']} modes", "latent": f"latent, {marks['r']} numbers"}
        return words.get(space, f"{space} space")
