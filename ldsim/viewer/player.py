"""Playing motions back: those that a run was made from, or takes that were recorded by hand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ldsim.arrays import Indices
from ldsim.errors import MotionError
from ldsim.mechanics.loads import MotionLoads
from ldsim.mechanics.motion import Motion
from ldsim.simulator import Simulator


@dataclass(frozen=True, eq=False)
class PlayedMotion:
    """A motion that can be played.

    Attributes:
        motion: what pulls.
        role: in its run; empty for a take.
        held: vertices that its drags are known to hold, by drag; others are found as they begin.
    """

    motion: Motion
    role: str = ""
    held: Mapping[int, Indices] = field(default_factory=dict)

    @property
    def words(self) -> str:
        """What the page says beside the name."""
        return self.role or f"{self.motion.frames} frames"


class Player:
    """One motion at a time, from rest, in every space that is shown.

    Attributes:
        pieces: what can be played, by name.
        chosen: the name of what is played next; empty where there is nothing.
    """

    def __init__(self, pieces: Mapping[str, PlayedMotion] | None = None) -> None:
        self.pieces: dict[str, PlayedMotion] = dict(pieces or {})
        self.chosen = next(iter(self.pieces), "")
        self.playing = False
        self._frame = 0
        self._loads: MotionLoads | None = None

    def status(self) -> dict[str, object]:
        """What the page shows of it."""
        words = {name: piece.words for name, piece in dict(self.pieces).items()}  # a page asks from another thread
        return {"playing": self.playing, "motions": words, "chosen": self.chosen}

    def choose(self, name: str) -> None:
        """What is played from now on.

        Raises:
            MotionError: there is no such motion, or one is being played.
        """
        if self.playing:
            raise MotionError("a motion is being played; stop it, then choose another")
        if name not in self.pieces:
            raise MotionError(f"there is no motion {name!r} to play; there are {', '.join(self.pieces) or 'none'}")
        self.chosen = name

    def add(self, name: str, piece: PlayedMotion) -> None:
        """One more, which is played next."""
        self.pieces[name], self.chosen = piece, name

    def remove(self, name: str) -> None:
        """One less; the last of the others is played next."""
        self.choose(name)
        del self.pieces[name]
        self.chosen = next(reversed(self.pieces), "")

    def play(self, simulators: Sequence[Simulator]) -> None:
        """Begin; the simulators are at rest.

        Raises:
            MotionError: there is nothing to play.
        """
        if not self.chosen:
            raise MotionError(
                "nothing to play: there is no motion yet; record one, or name one with `ldsim record --play`"
            )
        piece = self.pieces[self.chosen]
        self._loads = MotionLoads(piece.motion, simulators[0].scene, dict(piece.held))
        self.playing, self._frame = True, 0

    def stop(self, simulators: Sequence[Simulator]) -> None:
        """End, and let go."""
        if self.playing:
            for simulator in simulators:
                simulator.set_grabs([])
        self.playing = False

    def prepare(self, simulators: Sequence[Simulator]) -> bool:
        """Before each step: set the loads of the next frame; false when the motion ends here."""
        if not self.playing:
            return True
        assert self._loads is not None
        if self._frame >= self.pieces[self.chosen].motion.frames:
            self.stop(simulators)
            return False
        u = simulators[0].displacement() if self._loads.needs_state(self._frame) else None
        loads = self._loads.at(self._frame, u)
        for simulator in simulators:
            simulator.set_grabs(loads.grabs)
            simulator.set_pins(loads.pins)
            if loads.gravity is not None:
                simulator.gravity = loads.gravity
        self._frame += 1
        return True
