"""Scripted motions: keyframes in time become grabs, moving pins and gravity, frame by frame.

Frame i is the state at time (i + 1) h. Between keyframes a value goes straight or, eased, along the cubic 3s² − 2s³,
which starts and stops without a jerk; before the first and after the last it stays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ldsim.arrays import Array, Indices
from ldsim.errors import MotionError
from ldsim.mechanics.motion import Drag, Motion, Support
from ldsim.mechanics.options import (
    MOST_FRAMES,
    GravitySweepOptions,
    MovingPinsOptions,
    ReleaseOptions,
    ScriptOptions,
)
from ldsim.mechanics.scene import Scene


@dataclass(frozen=True, eq=False)
class Path:
    """Values along keyframes.

    Attributes:
        times: of the keyframes, (p,) float64 with p ≥ 2, rising, s.
        values: (p, d) float64.
        eased: whether each stretch starts and ends at rest.
    """

    times: Array
    values: Array
    eased: bool

    @classmethod
    def of(cls, keyframes: Sequence[tuple[float, ArrayLike]], eased: bool) -> Path:
        """From pairs of a time, s, and a value, (d,)."""
        times = np.array([time for time, _ in keyframes], dtype=np.float64)
        return cls(times, np.array([value for _, value in keyframes], dtype=np.float64), eased)

    def at(self, times: Array) -> Array:
        """The values at given times, (t, d)."""
        i = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(self.times) - 2)
        share = np.clip((times - self.times[i]) / (self.times[i + 1] - self.times[i]), 0, 1)
        if self.eased:
            share = share * share * (3 - 2 * share)
        return self.values[i] + share[:, None] * (self.values[i + 1] - self.values[i])


def frame_times(frames: int, time_step: float) -> Array:
    """(i + 1) h of each frame, s."""
    return time_step * np.arange(1, frames + 1, dtype=np.float64)


def frames_until(time: float, time_step: float) -> int:
    """The frames that end at or before a time, at least one; a time within rounding of a frame counts."""
    if time > MOST_FRAMES * time_step:
        raise MotionError(f"{time:g} s are more than {MOST_FRAMES} steps of {time_step:g} s; choose a shorter motion")
    return max(int(np.floor(time / time_step + 1e-6)), 1)


def grab_along(path: Path, point: ArrayLike, radius: float, stiffness: float, at_rest: bool, time_step: float) -> Drag:
    """A drag whose target follows a path, (d = 3) metres, from the first keyframe to the last.

    Args:
        point: where it takes hold, (3,) metres, on the rest shape or the deformed one.

    Raises:
        MotionError: no frame lies in between.
    """
    start = int(np.ceil(path.times[0] / time_step - 1e-6)) - 1
    stop = frames_until(float(path.times[-1]), time_step)
    start = max(start, 0)
    if start >= stop:
        first, last = path.times[[0, -1]]
        raise MotionError(f"a grab from {first:g} to {last:g} s holds no frame; they are {time_step:g} s apart")
    targets = path.at(frame_times(stop, time_step)[start:])
    return Drag(start, np.array(point, dtype=np.float64), targets, radius, stiffness, at_rest)


def support_along(path: Path, vertices: Indices, centre: ArrayLike, axis: ArrayLike, times: Array) -> Support:
    """Pins that follow a path of translation and turn, x = R(axis, angle) (X − centre) + centre + translation.

    Args:
        path: d = 4: translation, m, and angle, radians; it must start at rest, with all four zero.
        vertices: which pins, (v,).
        centre: a point on the axis, (3,) metres.
        axis: direction, (3,); of any length but zero.
        times: of the frames, s.

    Raises:
        MotionError: the axis has no direction, or the path does not start at rest.
    """
    direction, middle = np.asarray(axis, dtype=np.float64), np.asarray(centre, dtype=np.float64)
    length = np.linalg.norm(direction)
    if not length > 0:
        raise MotionError(f"the axis of a turn is {direction.tolist()}; it must have a direction")
    if path.values[0].any():
        raise MotionError(
            f"a path of pins must start at rest: the keyframe at {path.times[0]:g} s has translation "
            f"{path.values[0, :3].tolist()} and angle {np.degrees(path.values[0, 3]):g}, allowed is 0 for both"
        )
    values = path.at(times)
    rotation = rotations(direction / length, values[:, 3])
    offset = middle - rotation @ middle + values[:, :3]
    return Support(np.asarray(vertices, dtype=np.int64), np.concatenate([rotation, offset[:, :, None]], axis=2))


def rotations(axis: Array, angles: Array) -> Array:
    """Rotations about a unit axis, (t, 3, 3), by Rodrigues' formula R = I + sin a K + (1 − cos a) K²."""
    x, y, z = axis
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    s, c = np.sin(angles)[:, None, None], np.cos(angles)[:, None, None]
    R: Array = np.eye(3) + s * K + (1 - c) * (K @ K)
    return R


def gravity_sweep(start: ArrayLike, frames: int, turns: int) -> Array:
    """Gravity that points in every direction in turn, (frames, 3), m/s², of constant size.

    Its tip winds from `start` to the opposite on a spherical spiral of equal areas: the height falls evenly, so every
    direction is as near as another.

    Args:
        start: the first direction and the size, (3,) m/s².
        turns: of the spiral.

    Raises:
        MotionError: the size is zero.
    """
    g = np.asarray(start, dtype=np.float64)
    size = float(np.linalg.norm(g))
    if not size > 0:
        raise MotionError("a gravity sweep of size 0 m/s² moves nothing; give gravity_sweep.size")
    pole = g / size
    side = np.cross(pole, np.eye(3)[np.abs(pole).argmin()])
    side /= np.linalg.norm(side)
    share = np.arange(1, frames + 1) / frames
    height, around = 1 - 2 * share, 2 * np.pi * turns * share
    width = np.sqrt(np.maximum(1 - height**2, 0))
    across = np.cos(around)[:, None] * side + np.sin(around)[:, None] * np.cross(pole, side)
    swept: Array = size * (height[:, None] * pole + width[:, None] * across)
    return swept


def scripted(name: str, scene: Scene, script: ScriptOptions) -> Motion:
    """The motion of a script.

    Raises:
        MotionError: pins that are none, that follow two paths, or whose path does not start at rest.
        SceneError: a region that the solid has not.
    """
    h = scene.time_step
    paths = [*script.grabs, *script.moving_pins, *([script.gravity] if script.gravity else [])]
    last = max(path.keyframes[-1].time for path in paths)
    times = frame_times(frames_until(script.duration or last, h), h)
    drags = []
    for grab in script.grabs:
        path = Path.of([(each.time, each.target) for each in grab.keyframes], grab.eased)
        drag = grab_along(path, grab.point, grab.radius, grab.stiffness, grab.at_rest, h)
        if drag.start >= len(times):
            raise MotionError(f"a grab begins at {path.times[0]:g} s, when the motion of {times[-1]:g} s is over")
        drags.append(drag)
    gravity = None
    if script.gravity is not None:
        keyframes = [(each.time, each.acceleration) for each in script.gravity.keyframes]
        gravity = Path.of(keyframes, script.gravity.eased).at(times)
    supports = tuple(_support(scene, moving, times) for moving in script.moving_pins)
    _check_disjoint(supports)
    return Motion(name, len(times), tuple(drags), gravity, supports)


def _support(scene: Scene, moving: MovingPinsOptions, times: Array) -> Support:
    place = moving.where
    vertices = np.flatnonzero(place.vertices_in(scene.mesh, "moves") & scene.pinned)
    if len(vertices) == 0:
        raise MotionError(f"{place} holds no pinned vertex; only pins can follow a path, so pin them (mesh.pins)")
    centre = scene.mesh.vertices[vertices].mean(axis=0) if moving.centre is None else moving.centre
    poses = [(pose.time, (*pose.translation, np.radians(pose.angle))) for pose in moving.keyframes]
    path = Path.of(poses, moving.eased)
    return support_along(path, vertices, centre, moving.axis, times)


def _check_disjoint(supports: tuple[Support, ...]) -> None:
    moved = np.concatenate([np.empty(0, dtype=np.int64), *(support.vertices for support in supports)])
    vertices, counts = np.unique(moved, return_counts=True)
    if (counts > 1).any():
        raise MotionError(
            f"vertex {vertices[counts.argmax()]} follows two paths; regions of moving_pins must not overlap"
        )


def swept(name: str, scene: Scene, options: GravitySweepOptions) -> Motion:
    """Gravity from every direction in turn; −y is the first where the scene has none."""
    g = scene.gravity if scene.gravity.any() or options.size is None else np.array([0.0, -1.0, 0.0])
    start = g if options.size is None else g * (options.size / np.linalg.norm(g))
    frames = frames_until(options.duration, scene.time_step)
    return Motion(name, frames, gravity=gravity_sweep(start, frames, options.turns))


def released(name: str, scene: Scene, options: ReleaseOptions) -> Motion:
    """Pulled slowly into a pose, held there, let go."""
    there, let_go = options.pull, options.pull + options.hold
    held = [(0.0, options.point), (there, options.target), (let_go, options.target)]
    path = Path.of(held if options.hold > 0 else held[:2], eased=True)
    drag = grab_along(path, options.point, options.radius, options.stiffness, True, scene.time_step)
    return Motion(name, frames_until(let_go + options.swing, scene.time_step), (drag,))
