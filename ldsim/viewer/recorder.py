"""Recording grabs to a motion file, and playing one back."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ldsim.arrays import Array
from ldsim.errors import MotionError
from ldsim.mechanics.loads import MotionLoads
from ldsim.mechanics.motion import Drag, Motion
from ldsim.mechanics.recording import write_recording
from ldsim.simulator import Handle, Simulator


class Recorder:
    """One hand on one solid, frame by frame.

    Args:
        path: the file that the first take is written to; an older one is replaced. Further takes lie beside it, as
            motion-2.csv and so on.
        stiffness, radius: of every grab, N/m and m.
        notes: further lines of the file.
        motion: what can be played back before anything is recorded.

    Raises:
        MotionError: the file's folder does not exist.
    """

    def __init__(
        self,
        path: Path,
        stiffness: float,
        radius: float,
        notes: Mapping[str, str | float],
        motion: Motion | None = None,
    ) -> None:
        if not path.parent.is_dir():
            raise MotionError(
                f"recording {path} cannot be written: {path.parent} is no folder; choose another --output"
            )
        self._path, self._stiffness, self._radius, self._notes = path, stiffness, radius, notes
        self.takes: dict[str, Motion] = {} if motion is None else {motion.name: motion}
        self.take = next(iter(self.takes), "")
        self._recorded: dict[str, Path] = {}
        self._count = 0
        self.recording = self.replaying = False
        self._frames = 0
        self._drags: list[Drag] = []
        self._point: Array | None = None
        self._target = np.zeros(3)
        self._targets: list[Array] = []
        self._loads: MotionLoads | None = None

    def status(self) -> dict[str, object]:
        """What the page shows of it."""
        return {
            "recording": self.recording,
            "replaying": self.replaying,
            "file": self._path.name,
            "takes": {name: motion.frames for name, motion in self.takes.items()},
            "take": self.take,
        }

    def record(self, value: bool) -> str:
        """Start a recording from rest, or end it and write the file; returns what to say."""
        self.recording, self.replaying = value, False
        if value:
            self._frames, self._drags, self._targets, self._point = 0, [], [], None
            return "recording: pull on the solid"
        self.release()
        self._count += 1
        path = self._path if self._count == 1 else self._path.with_stem(f"{self._path.stem}-{self._count}")
        motion = Motion(path.stem, self._frames, tuple(self._drags))
        write_recording(path, motion, self._notes)
        self.takes[path.stem], self._recorded[path.stem], self.take = motion, path, path.stem
        return f"{path}: {self._frames} frames, {len(self._drags)} pulls"

    def choose(self, take: str) -> None:
        """The take that is played back from now on."""
        if take not in self.takes:
            raise MotionError(f"there is no take {take!r}; there are {', '.join(self.takes) or 'none'}")
        self.take = take

    def discard(self, take: str) -> None:
        """Forget a take, and delete its file where it was recorded here."""
        self.choose(take)
        del self.takes[take]
        if take in self._recorded:
            self._recorded.pop(take).unlink(missing_ok=True)
        self.take = next(reversed(self.takes), "")

    def replay(self, value: bool, simulator: Simulator) -> None:
        """Play the take from rest from now on, or stop doing so."""
        if value and not self.take:
            raise MotionError("nothing to play back: record something first, or name a recording with --play")
        if value:
            self._loads = MotionLoads(self.takes[self.take], simulator.scene)
        self.recording, self.replaying, self._frames = False, value, 0
        simulator.set_grabs([])

    def grab(self, simulator: Simulator, point: Array, target: Array) -> Handle:
        """Take hold at a point of the deformed solid; a frame after the grab before, whose rows it must not touch."""
        if self.recording and self._drags and self._drags[-1].stop == self._frames:
            simulator.step()
            self._frames += 1
        handle = simulator.grab(point, target, self._stiffness, self._radius)
        self._point, self._target = point, target
        return handle

    def move(self, target: Array) -> None:
        """The grab pulls to another target from the next frame on."""
        self._target = target

    def release(self) -> None:
        """The grab lets go; one that lasted no frame leaves no trace."""
        if self._point is not None and self._targets:
            start = self._frames - len(self._targets)
            self._drags.append(Drag(start, self._point, np.array(self._targets), self._radius, self._stiffness))
        self._point, self._targets = None, []

    def prepare(self, simulator: Simulator) -> bool:
        """Before each step: note the frame, or set the grabs of the one played back; false when that ends here."""
        if self.replaying:
            return self._play(simulator)
        if self.recording:
            if self._point is not None:
                self._targets.append(self._target)
            self._frames += 1
        return True

    def _play(self, simulator: Simulator) -> bool:
        assert self._loads is not None
        if self._frames >= self.takes[self.take].frames:
            self.replay(False, simulator)
            return False
        u = simulator.displacement() if self._loads.needs_state(self._frames) else None
        loads = self._loads.at(self._frames, u)
        simulator.set_grabs(loads.grabs)
        simulator.set_pins(loads.pins)
        self._frames += 1
        return True
