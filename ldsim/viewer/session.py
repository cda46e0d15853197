"""The stepping behind the page: one thread obeys the page, steps at the pace of time, and publishes frames."""

from __future__ import annotations

import math
import queue
import threading
import time
import warnings
from collections.abc import Callable, Sequence

import numpy as np

from ldsim.arrays import Array
from ldsim.errors import LdsimError
from ldsim.simulator import Handle, Simulator, StepRecord
from ldsim.simulator.fields import FIELDS, VertexField
from ldsim.viewer import protocol
from ldsim.viewer.payload import MAX_GRABS, GrabFrame, field_bytes, frame_bytes, space_block
from ldsim.viewer.recorder import Recorder
from ldsim.viewer.state import Audience, Errors, Held, Look, space_frame

TICK = 1 / 60
FIELD_EVERY = 0.1
# The longest a tick may step; what is not done by then is dropped, and time runs slower than asked.
BUDGET = 0.1
COLOURS = ("plain", "displacement", *FIELDS, "novelty")


class Session:
    """Simulators side by side under one hand.

    Args:
        open_space: makes the simulator of a space.
        offered: the spaces that may be shown.
        first: those shown at the start, already open.
        recorder: what a recording goes into; None where nothing is recorded.
    """

    def __init__(
        self,
        open_space: Callable[[str], Simulator],
        offered: Sequence[str],
        first: Sequence[Simulator],
        recorder: Recorder | None = None,
    ) -> None:
        self._open_space, self.offered = open_space, tuple(offered)
        self._open = {simulator.space.name: simulator for simulator in first}
        self.blocks = {simulator.space.name: space_block(simulator) for simulator in first}
        self._shown = list(first)
        self.recorder = recorder
        self._field = VertexField(first[0].scene, first[0].surface.vertices)
        self._field(FIELDS[0], first[0].displacement(), 1.0)  # compiled now, before a page waits for it
        x, y, z = (float(value) for value in first[0].gravity)
        self.look = Look((x, y, z))
        self._held: dict[int, Held] = {}
        self._told: queue.Queue[tuple[int, protocol.Message | None]] = queue.Queue(maxsize=1000)
        self._watched, self._stopped = threading.Event(), threading.Event()
        self._audience = Audience(lambda _: None, lambda _, __: None, lambda _: None, lambda _: None)
        self._number, self._simulated = 0, 0.0
        self._field_time, self._high = 0.0, 0.0
        self._errors = Errors()
        self._records: list[list[StepRecord]] = []  # of each space shown, since the last frame

    # What the server calls, from its own thread

    def tell(self, client: int, message: protocol.Message | None) -> bool:
        """Pass on a message, or with None that a page has left; false where too many wait already."""
        try:
            self._told.put_nowait((client, message))
        except queue.Full:
            return False
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

    def _tick(self, debt: float) -> float:
        """Obey, step and publish once; whatever goes wrong is told and costs the shape, never the page."""
        try:
            self.obey()
            debt = self.advance(debt)
            self.publish()
        except Exception as error:
            self._reset()
            self._audience.notice(f"back at rest, because of an error in a step: {error!r}")
            return 0.0
        return debt

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
        if self.recorder is not None and not self._prepared(self.recorder):
            self._audience.status(self.status())
        self._records = self._records or [[] for _ in self._shown]
        for simulator, records in zip(self._shown, self._records, strict=True):
            records.append(simulator.step())
        self._errors.add(self._shown)
        self._simulated += self._shown[0].scene.time_step

    def _prepared(self, recorder: Recorder) -> bool:
        """Whether the recorder goes on; a motion that belongs to another solid is told and ends."""
        try:
            return recorder.prepare(self._shown[0])
        except LdsimError as error:
            recorder.replay(False, self._shown[0])
            self._audience.notice(f"the playback ends: {error}")
            return False

    def publish(self) -> None:
        """Send the present frame, and now and then the colours."""
        self._number += 1
        present = self._records or [[] for _ in self._shown]
        pairs = zip(self._shown, present, strict=True)
        spaces = [space_frame(simulator, steps, self._errors.of(simulator.space.name)) for simulator, steps in pairs]
        grabs = [GrabFrame(key, held.target, [h.centroid for h in held.handles]) for key, held in self._held.items()]
        recorder = self.recorder
        flags = self.look.paused + (0 if recorder is None else 2 * recorder.recording + 4 * recorder.replaying)
        self._audience.frame(frame_bytes(self._number, self._simulated, self.look.speed, flags, spaces, grabs))
        self._records = []
        if self.look.colour in FIELDS and time.perf_counter() - self._field_time > FIELD_EVERY:
            self._publish_fields()

    def _publish_fields(self) -> None:
        self._field_time = time.perf_counter()
        fields = [
            self._field(self.look.colour, simulator.displacement(), simulator.material_scale)
            for simulator in self._shown
        ]
        largest = max(float(np.percentile(values, 99)) for values in fields)
        if largest > self._high:  # the scale is held; it grows by round steps until the colour is chosen anew
            self._high = rounded_up(largest)
        for i, values in enumerate(fields):
            self._audience.colours(i, field_bytes(i, values, 0.0, self._high))

    def status(self) -> dict[str, object]:
        """All that the page shows besides the frames."""
        look, recorder = self.look, self.recorder
        return {
            "kind": "status",
            "offered": self.offered,
            "spaces": [simulator.space.name for simulator in self._shown],
            "gravity": look.gravity,
            "stiffness": look.stiffness,
            "speed": look.speed,
            "paused": look.paused,
            "colour": look.colour,
            "recorder": None if recorder is None else recorder.status(),
        }

    # Obeying, one method a message

    def _do(self, client: int, message: protocol.Message | None) -> bool:
        """Do what a message says; returns whether the page's controls show it."""
        if message is None:
            self._leave(client)
            return True
        match message:
            case protocol.GrabMessage():
                self._grab(client, message)
            case protocol.MoveMessage():
                self._move(message.id, np.array(message.target))
            case protocol.ReleaseMessage():
                self._release(message.id)
            case protocol.GravityMessage():
                self._condition(message.value, self.look.stiffness)
            case protocol.NumberMessage(kind="stiffness"):
                self._condition(self.look.gravity, min(max(message.value, 0.01), 100.0))
            case protocol.NumberMessage():
                self.look.speed = min(max(message.value, 0.01), 4.0)
            case protocol.SwitchMessage(kind="pause"):
                self.look.paused = message.value
            case protocol.SwitchMessage(kind="record"):
                self._record(message.value)
            case protocol.SwitchMessage():
                self._replay(message.value)
            case protocol.ButtonMessage(kind="step"):
                self.look.paused = True
                self.step()
            case protocol.ButtonMessage():
                self._reset()
            case protocol.SpacesMessage():
                self._show(message.value)
            case protocol.WordMessage(kind="colour"):
                self._colour(message.value)
            case protocol.WordMessage():
                self._take(message)
        return message.kind not in ("grab", "move", "release")

    def _leave(self, client: int) -> None:
        for key in [key for key, held in self._held.items() if held.client == client]:
            self._release(key)

    def _grab(self, client: int, message: protocol.GrabMessage) -> None:
        recorder = self.recorder
        limit = MAX_GRABS if recorder is None else 1
        if len(self._held) >= limit or message.id in self._held or (recorder is not None and recorder.replaying):
            return
        target, handles = np.array(message.target), list[Handle]()
        try:
            with warnings.catch_warnings(record=True) as warned:
                warnings.simplefilter("always")
                for simulator in self._shown:
                    if recorder is None:
                        handles.append(simulator.grab(message.point, target, at_rest=True))
                    else:
                        handles.append(recorder.grab(simulator, np.array(message.point), target))
        except LdsimError:
            for handle in handles:
                handle.release()
            raise
        if warned:
            self._audience.notice("this place is pinned and will not move; pull where the solid can give way")
        self._held[message.id] = Held(client, target, handles)

    def _move(self, key: int, target: Array) -> None:
        held = self._held.get(key)
        if held is None:
            return
        held.target = target
        for handle in held.handles:
            handle.move(target)
        if self.recorder is not None:
            self.recorder.move(target)

    def _release(self, key: int) -> None:
        held = self._held.pop(key, None)
        for handle in held.handles if held is not None else ():
            handle.release()
        if held is not None and self.recorder is not None:
            self.recorder.release()

    def _condition(self, gravity: protocol.Place, stiffness: float) -> None:
        if self.recorder is not None and (self.recorder.recording or self.recorder.replaying):
            raise LdsimError("gravity and stiffness stay as they are in a recording; its file does not hold them")
        self.look.gravity, self.look.stiffness = gravity, stiffness
        for simulator in self._shown:
            simulator.gravity = self.look.gravity
            simulator.material_scale = self.look.stiffness

    def _reset(self) -> None:
        self._held.clear()
        for simulator in self._shown:
            simulator.reset()
        self._simulated, self._records, self._errors = 0.0, [], Errors()

    def _show(self, names: tuple[str, ...]) -> None:
        if any(name not in self.offered for name in names) or len(set(names)) < len(names):
            raise LdsimError(f"spaces {', '.join(names)} asked for; offered are {', '.join(self.offered)}")
        for name in names:
            if name not in self._open:
                self._audience.notice(f"opening the {name} space")
                self._open[name] = self._open_space(name)
                self.blocks[name] = space_block(self._open[name])
        before, self._shown = self._shown, [self._open[name] for name in names]
        for simulator in self._shown:
            if simulator not in before:
                simulator.follow(before[0])
        for held in self._held.values():
            kept = dict(zip(before, held.handles, strict=True))
            held.handles = [kept.get(each) or held.handles[0].on(each) for each in self._shown]
        self._records, self._errors = [], Errors()

    def _colour(self, name: str) -> None:
        if name not in COLOURS:
            raise LdsimError(f"colour {name!r} asked for; known are {', '.join(COLOURS)}")
        self.look.colour, self._high, self._field_time = name, 0.0, 0.0

    def _record(self, value: bool) -> None:
        if self.recorder is None:
            raise LdsimError("nothing is recorded here; `ldsim record` does")
        self._reset()
        self._audience.notice(self.recorder.record(value))

    def _take(self, message: protocol.WordMessage) -> None:
        if self.recorder is None:
            raise LdsimError("there are no takes here; `ldsim record` makes some")
        if self.recorder.recording or self.recorder.replaying:
            raise LdsimError("stop first; then choose or delete a take")
        (self.recorder.choose if message.kind == "take" else self.recorder.discard)(message.value)

    def _replay(self, value: bool) -> None:
        if self.recorder is None:
            raise LdsimError("nothing is played back here; `ldsim record` does")
        self._reset()
        self.recorder.replay(value, self._shown[0])


def rounded_up(value: float) -> float:
    """The next of 1, 2 and 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(value)) if value > 0 else 0.0
    return next((step * power for step in (1, 2, 5) if step * power >= value), 10 * power)
