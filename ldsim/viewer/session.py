"""The stepping behind the page: one thread obeys the page, steps at the pace of time, and publishes frames."""

from __future__ import annotations

import queue
import threading
import time
import warnings
from collections.abc import Callable, Sequence

import numpy as np

from ldsim.arrays import Array
from ldsim.errors import LdsimError
from ldsim.simulator import Handle, Simulator, StepRecord
from ldsim.viewer import protocol
from ldsim.viewer.colours import NAMES, Colours
from ldsim.viewer.hands import Hands
from ldsim.viewer.payload import MAX_GRABS, GrabFrame, frame_bytes, space_block
from ldsim.viewer.player import Player
from ldsim.viewer.recorder import Recorder
from ldsim.viewer.state import Audience, Errors, PageLook, space_frame

TICK = 1 / 60
# The longest a tick may step; what is not done by then is dropped, and time runs slower than asked.
BUDGET = 0.1
# Messages that wait to be obeyed, and of these moves of pulls.
MOST_WAITING, MOST_MOVES = 1000, 500


class Session:
    """Simulators side by side under one hand.

    Args:
        open_space: makes the simulator of a space.
        offered: the spaces that may be shown.
        first: those shown at the start, already open.
        played: what a recording goes into, or where nothing is recorded, what plays the motions of the run.

    Attributes:
        hands: what the pages hold.
        farewell: what is to be said when `run` has ended; empty where there is nothing.
    """

    def __init__(
        self,
        open_space: Callable[[str], Simulator],
        offered: Sequence[str],
        first: Sequence[Simulator],
        played: Recorder | Player | None = None,
    ) -> None:
        self._open_space, self.offered = open_space, tuple(offered)
        self._open = {simulator.space.name: simulator for simulator in first}
        self.blocks = {simulator.space.name: space_block(simulator) for simulator in first}
        self._shown = list(first)
        self.recorder = played if isinstance(played, Recorder) else None
        self.player = played.player if isinstance(played, Recorder) else played or Player()
        self._colours = Colours(first[0].scene, first[0].surface)
        x, y, z = (float(value) for value in first[0].gravity)
        self.look = PageLook((x, y, z))
        self.hands = Hands()
        self.farewell = ""
        self._told: queue.SimpleQueue[tuple[int, protocol.Message | None]] = queue.SimpleQueue()
        self._watched, self._stopped = threading.Event(), threading.Event()
        self._audience = Audience(lambda _: None, lambda _, __: None, lambda _: None, lambda _: None)
        self._number, self._simulated = 0, 0.0
        self._errors = Errors()
        self._records: list[list[StepRecord]] = []  # of each space shown, since the last frame

    @property
    def _recording(self) -> bool:
        return self.recorder is not None and self.recorder.recording

    # What the server calls, from its own thread

    def tell(self, client: int, message: protocol.Message | None) -> bool:
        """Pass on a message, or with None that a page has left; false where too many messages wait already.

        That a page has left is always passed on, behind all that it said before: what it holds would be held for ever.
        Moves of a pull are dropped before that, as many come while a space opens, and the next one says the same.
        """
        waiting = self._told.qsize()
        if isinstance(message, protocol.MoveMessage) and waiting >= MOST_MOVES:
            return True
        if message is not None and waiting >= MOST_WAITING:
            return False
        self._told.put((client, message))
        return True

    def watch(self, audience: Audience) -> None:
        """Step, and tell the audience, from now on."""
        self._audience = audience
        self._watched.set()

    def unwatch(self) -> None:
        """Stand still until somebody watches."""
        self._watched.clear()

    def stop(self) -> None:
        """End `run`."""
        self._stopped.set()
        self._watched.set()

    # The stepping thread

    def run(self) -> None:
        """Obey, step and publish until stopped."""
        debt, before = 0.0, time.perf_counter()
        while not self._stopped.is_set():
            if not self._watched.is_set():
                self._watched.wait()
                before = time.perf_counter()
            started = time.perf_counter()
            debt += (started - before) * self.look.speed
            before = started
            debt = self._tick(debt)
            time.sleep(max(TICK - (time.perf_counter() - started), 0.001))
        if self._recording:
            self.farewell = self._end_recording("here")

    def _tick(self, debt: float) -> float:
        """Obey, step and publish once; whatever goes wrong is told and costs the shape, never the page."""
        try:
            self.obey()
            debt = self.advance(debt)
            self.publish()
        except Exception as error:
            self._reset()
            cut = f"; {self._end_recording('before it')}" if self._recording else ""
            self._audience.notice(f"back at rest, because of an error in a step: {error!r}{cut}")
            self._audience.status(self.status())
            return 0.0
        return debt

    def _end_recording(self, where: str) -> str:
        """End a recording that nobody has stopped; returns what to say of it."""
        assert self.recorder is not None
        try:
            return f"the recording ends {where}, {self.recorder.record(False)}"
        except Exception as lost:  # a second error here would end the stepping thread, and the page with it
            return f"the recording is lost: {lost}"

    def obey(self) -> None:
        """Do all that was told since the last time."""
        changed = False
        while True:
            try:
                client, message = self._told.get_nowait()
            except queue.Empty:
                break
            try:
                changed |= self._do(client, message)
            except LdsimError as error:
                self._audience.notice(str(error))
                changed = True  # the page may show what it asked for, which is not what is
        if changed:
            self._audience.status(self.status())

    def advance(self, debt: float) -> float:
        """Step until the simulated time owed is less than a time step; returns what is still owed."""
        h, deadline = self._shown[0].scene.time_step, time.perf_counter() + BUDGET
        if self.look.paused:
            return 0.0
        while debt >= h:
            self.step()
            debt -= h
            if time.perf_counter() > deadline:
                return 0.0
        return debt

    def step(self) -> None:
        """One time step in every space shown."""
        if not self._prepared():
            self._condition()
            self._audience.status(self.status())
        self._records = self._records or [[] for _ in self._shown]
        for simulator, records in zip(self._shown, self._records, strict=True):
            records.append(simulator.step())
        if self.recorder is not None:
            self.recorder.note()
        self._errors.add(self._shown)
        self._simulated += self._shown[0].scene.time_step

    def _prepared(self) -> bool:
        """Whether what is played goes on; a motion that belongs to another solid is told and ends."""
        try:
            return self.player.prepare(self._shown)
        except LdsimError as error:
            self.player.stop(self._shown)
            self._audience.notice(f"the playback ends: {error}")
            return False

    def publish(self) -> None:
        """Send the present frame, and now and then the colours."""
        self._number += 1
        present = self._records or [[] for _ in self._shown]
        pairs = zip(self._shown, present, strict=True)
        spaces = [space_frame(simulator, steps, self._errors.of(simulator.space.name)) for simulator, steps in pairs]
        flags = self.look.paused + 2 * self._recording + 4 * self.player.playing
        grabs = self._played_grabs() if self.player.playing else self.hands.frames()
        self._audience.frame(frame_bytes(self._number, self._simulated, self.look.speed, flags, spaces, grabs))
        self._records = []
        for i, colours in enumerate(self._colours.of(self.look.colour, self._shown)):
            self._audience.colours(i, colours)

    def _played_grabs(self) -> list[GrabFrame]:
        """What the motion that is played holds; the page's own numbers begin elsewhere."""
        rows = zip(*(simulator.grabs for simulator in self._shown), strict=True)
        return [
            GrabFrame(i, row[0].target, [s.centroid(grab.vertices) for s, grab in zip(self._shown, row, strict=True)])
            for i, row in enumerate(rows)
        ]

    def status(self) -> dict[str, object]:
        """All that the page shows besides the frames."""
        look = self.look
        return {
            "kind": "status",
            "offered": self.offered,
            "spaces": [simulator.space.name for simulator in self._shown],
            "gravity": look.gravity,
            "stiffness": look.stiffness,
            "speed": look.speed,
            "paused": look.paused,
            "colour": look.colour,
            "recorder": None if self.recorder is None else self.recorder.status(),
            "player": self.player.status(),
        }

    # Obeying, one method a message

    def _do(self, client: int, message: protocol.Message | None) -> bool:
        """Do what a message says; returns whether the page's controls show it."""
        if message is None:
            self._leave(client)
            return True
        match message:
            case protocol.GrabMessage():
                return self._grab(client, message)
            case protocol.MoveMessage():
                self._move(message.id, np.array(message.target))
            case protocol.ReleaseMessage():
                self._release(message.id)
            case protocol.GravityMessage():
                self._refuse_while("gravity stays as it is")
                self.look.gravity = message.value
                self._condition()
            case protocol.NumberMessage(kind="stiffness"):
                self._refuse_while("stiffness stays as it is")
                self._stiffen(min(max(message.value, 0.01), 100.0))
            case protocol.NumberMessage():
                self.look.speed = min(max(message.value, 0.01), 4.0)
            case protocol.SwitchMessage(kind="pause"):
                self.look.paused = message.value
            case protocol.SwitchMessage(kind="record"):
                self._record(message.value)
            case protocol.SwitchMessage():
                self._play(message.value)
            case protocol.ButtonMessage(kind="step"):
                self.look.paused = True
                self.step()
            case protocol.ButtonMessage(kind="undo"):
                self._undo()
            case protocol.ButtonMessage():
                if self._recording:
                    raise LdsimError("a recording does not go back to rest; stop it, then record another take")
                self._stop_playing()  # what is remembered is held by hands alone
                self._remember()
                self._reset()
            case protocol.SpacesMessage():
                self._show(message.value)
            case protocol.WordMessage(kind="colour"):
                self._colour(message.value)
            case protocol.WordMessage():
                self._take(message)
        return message.kind not in ("grab", "move", "release")

    def _leave(self, client: int) -> None:
        for key in self.hands.of(client):
            self._release(key)
        self.hands.leave(client)

    def _grab(self, client: int, message: protocol.GrabMessage) -> bool:
        """Returns whether this ended a motion that was played: a hand is stronger than it."""
        recorder, playing = self.recorder, self.player.playing
        limit = MAX_GRABS if recorder is None else 1
        if len(self.hands.held) >= limit or message.id in self.hands.held:
            return False
        self._stop_playing()
        remembered = self._remember()

        def take_hold(simulator: Simulator) -> Handle:
            point, target = np.array(message.point), np.array(message.target)
            if recorder is None:
                return simulator.grab(point, target, at_rest=True)
            return recorder.grab(simulator, point, target)

        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            try:
                self.hands.grab(client, message, self._shown, take_hold)
            except LdsimError:
                if remembered:
                    self.hands.forget()
                raise
        if warned:
            self._audience.notice("this place is pinned and will not move; pull where the solid can give way")
        return playing

    def _move(self, key: int, target: Array) -> None:
        if self.hands.move(key, target) and self.recorder is not None:
            self.recorder.move(target)

    def _release(self, key: int) -> None:
        if self.hands.release(key) and self.recorder is not None:
            self.recorder.release()

    def _refuse_while(self, what: str) -> None:
        """A recording's file holds neither gravity nor stiffness, and no undo."""
        if self.player.playing or self._recording:
            raise LdsimError(f"{what} while a motion is recorded or played; stop first")

    def _condition(self) -> None:
        for simulator in self._shown:
            simulator.gravity, simulator.material_scale = self.look.gravity, self.look.stiffness

    def _stiffen(self, value: float) -> None:
        """In every space, or in none."""
        before, self.look.stiffness = self.look.stiffness, value
        try:
            self._condition()
        except LdsimError:
            self.look.stiffness = before
            self._condition()
            raise

    def _reset(self) -> None:
        self.player.stop(self._shown)
        self.hands.held.clear()
        for simulator in self._shown:
            simulator.reset()
        self._condition()
        self._simulated, self._records, self._errors = 0.0, [], Errors()

    def _remember(self) -> bool:
        """Keep the pose for an undo; not while a recording runs, which has none."""
        if not self._recording:
            self.hands.remember(self._shown, self._simulated)
        return not self._recording

    def _undo(self) -> None:
        if self._recording:
            raise LdsimError("a recording has no undo; stop it, and delete the take")
        self._stop_playing()
        self._simulated = self.hands.undo(self._shown)
        self._condition()
        self._records, self._errors = [], Errors()

    def _show(self, names: tuple[str, ...]) -> None:
        if any(name not in self.offered for name in names) or len(set(names)) < len(names):
            raise LdsimError(f"spaces {', '.join(names)} asked for; offered are {', '.join(self.offered)}")
        for name in names:
            if name not in self._open:
                self._audience.notice(f"opening the {name} space")
                self._open[name] = self._open_space(name)
                self.blocks[name] = space_block(self._open[name])
        before, shown = self._shown, [self._open[name] for name in names]
        for simulator in shown:
            if simulator not in before:
                simulator.follow(before[0])
        self._shown = shown
        self.hands.carry_over(before, self._shown)
        self._records, self._errors = [], Errors()

    def _colour(self, name: str) -> None:
        if name not in NAMES:
            raise LdsimError(f"colour {name!r} asked for; known are {', '.join(NAMES)}")
        self.look.colour = name
        self._colours.start()

    def _record(self, value: bool) -> None:
        if self.recorder is None:
            raise LdsimError("nothing is recorded here; `ldsim record` does")
        if value != self.recorder.recording:  # two pages may both have seen the button as it was
            if value:  # the file holds neither, so it is of the solid as its configuration has it
                x, y, z = self._shown[0].scene.gravity.tolist()
                self.look.gravity, self.look.stiffness = (x, y, z), 1.0
            self._reset()
            self._audience.notice(self.recorder.record(value))

    def _take(self, message: protocol.WordMessage) -> None:
        if self._recording:
            raise LdsimError("stop first; then choose or delete a take")
        if message.kind == "take":
            self.player.choose(message.value)
        elif self.recorder is None:
            raise LdsimError("motions of a run are not deleted here")
        else:
            self.recorder.discard(message.value)

    def _play(self, value: bool) -> None:
        if not value:
            self._stop_playing()
            return
        if self._recording:
            raise LdsimError("stop the recording first; then play it back")
        self._stop_playing()
        self._remember()
        self._reset()
        self.player.play(self._shown)

    def _stop_playing(self) -> None:
        if self.player.playing:
            self.player.stop(self._shown)
            self._condition()
