"""Recording grabs to motion files."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import chain, count
from pathlib import Path

import numpy as np

from ldsim.arrays import Array
from ldsim.artefacts.atomic import replacing
from ldsim.errors import LdsimError, MotionError
from ldsim.mechanics.motion import Drag, Motion
from ldsim.mechanics.recording import write_recording
from ldsim.simulator import Handle, Simulator
from ldsim.viewer.player import PlayedMotion, Player


class Recorder:
    """One hand on one solid, frame by frame.

    Args:
        path: the file that a take is written to; where there is one already, the first free of motion-2.csv and so on
            beside it.
        stiffness, radius: of every grab, N/m and m.
        notes: further lines of the file.
        motion: what can be played back before anything is recorded.
        takes_changed: told which files there are whenever one is written or deleted.

    Attributes:
        player: what plays the takes back.

    Raises:
        MotionError: the file's folder does not exist.
    """

    def __init__(
        self,
        path: Path,
        grip: tuple[float, float],
        notes: Mapping[str, str | float],
        motion: Motion | None = None,
        takes_changed: Callable[[Sequence[Path]], object] = lambda _: None,
    ) -> None:
        if not path.parent.is_dir():
            raise MotionError(
                f"recording {path} cannot be written: {path.parent} is no folder; choose another --output"
            )
        self._path, (self._stiffness, self._radius), self._notes = path, grip, notes
        self.player = Player({} if motion is None else {motion.name: PlayedMotion(motion)})
        self._takes_changed = takes_changed
        self._files: dict[str, Path] = {}
        self.recording = False
        self._frames = 0
        self._drags: list[Drag] = []
        self._point: Array | None = None
        self._target = np.zeros(3)
        self._targets: list[Array] = []

    def status(self) -> dict[str, object]:
        """What the page shows of it."""
        return {"recording": self.recording, "file": self._free().name}

    def record(self, value: bool) -> str:
        """Start a recording from rest, or end it and write the file, where it has a frame; returns what to say.

        Raises:
            MotionError: the file cannot be written, and the take is lost.
        """
        self.recording = value
        if value:
            self._frames, self._drags, self._targets, self._point = 0, [], [], None
            return "recording: pull on the solid"
        self.release()
        if not self._frames:
            return "nothing was recorded, as no time went by; no file is written"
        path = self._free()
        motion = Motion(path.stem, self._frames, tuple(self._drags))
        self._write(path, motion)
        self.player.add(path.stem, PlayedMotion(motion))
        self._files[path.stem] = path
        self._takes_changed([*self._files.values()])
        return f"{path}: {self._frames} frames, {len(self._drags)} pull{'s' * (len(self._drags) != 1)}"

    def _free(self) -> Path:
        """Where the next take goes: no recording by hand is ever replaced by another."""
        further = (self._path.with_stem(f"{self._path.stem}-{number}") for number in count(2))
        return next(path for path in chain([self._path], further) if not path.exists())

    def _write(self, path: Path, motion: Motion) -> None:
        """Whole or not at all."""
        try:
            with replacing(path) as temporary:
                write_recording(temporary, motion, self._notes)
        except LdsimError as error:
            reason = error.__cause__.strerror if isinstance(error.__cause__, OSError) else error
            raise MotionError(
                f"recording {path} cannot be written: {reason}; this take is lost: make room, then record another"
            ) from error

    def discard(self, take: str) -> None:
        """Forget a take, and delete its file where it was recorded here."""
        self.player.remove(take)
        if take in self._files:
            self._files.pop(take).unlink(missing_ok=True)
            self._takes_changed([*self._files.values()])

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

    def note(self) -> None:
        """After each step: note its frame. One that failed is none."""
        if self.recording:
            if self._point is not None:
                self._targets.append(self._target)
            self._frames += 1
