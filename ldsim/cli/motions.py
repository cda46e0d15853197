"""Motions of a configuration as the mechanics knows them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ldsim.cli.regions import region
from ldsim.cli.stage import Run
from ldsim.errors import LdsimError, MotionError
from ldsim.mechanics.motion import Drag, Motion, Support
from ldsim.mechanics.pulls import surface_pulls
from ldsim.mechanics.recording import read_recording
from ldsim.mechanics.regions import vertices_in
from ldsim.mechanics.scene import Scene
from ldsim.mechanics.script import (
    Path,
    frame_times,
    frames_until,
    grab_along,
    gravity_sweep,
    support_along,
)
from ldsim.settings import (
    GrabSettings,
    GravitySweepSettings,
    MotionSettings,
    MovingPinsSettings,
    ReleaseSettings,
    ScriptSettings,
    load_script,
    resolve_path,
)

Array = NDArray[np.float64]


def motion(run: Run, scene: Scene, settings: MotionSettings) -> Motion:
    """The motion that a configuration describes, for a scene.

    Raises:
        LdsimError: naming the motion.
    """
    try:
        whole = _motion(run, scene, settings)
    except LdsimError as error:
        raise type(error)(f"motion {settings.name}: {error}") from error
    return whole if settings.frames is None else whole.first(settings.frames)


def _motion(run: Run, scene: Scene, settings: MotionSettings) -> Motion:
    if settings.recording is not None:
        return read_recording(resolve_path(settings.recording, run.config), settings.name)
    if settings.pulls is not None:
        return surface_pulls(settings.name, scene, settings.pulls)
    if settings.script is not None:
        return _scripted(settings.name, scene, settings.script)
    if settings.script_file is not None:
        return _scripted(settings.name, scene, load_script(resolve_path(settings.script_file, run.config)))
    if settings.gravity_sweep is not None:
        return _sweep(settings.name, scene, settings.gravity_sweep)
    assert settings.release is not None
    return _release(settings.name, scene, settings.release)


def _scripted(name: str, scene: Scene, script: ScriptSettings) -> Motion:
    h = scene.time_step
    paths = [*script.grabs, *script.moving_pins, *([script.gravity] if script.gravity else [])]
    last = max(path.keyframes[-1].time for path in paths)
    times = frame_times(frames_until(script.duration or last, h), h)
    drags = [drag for grab in script.grabs if (drag := _grab(grab, h)) is not None and drag.start < len(times)]
    gravity = None
    if script.gravity is not None:
        keyframes = [(keyframe.time, keyframe.acceleration) for keyframe in script.gravity.keyframes]
        gravity = Path.of(keyframes, script.gravity.interpolation == "eased").at(times)
    supports = tuple(_support(scene, moving, times) for moving in script.moving_pins)
    _check_disjoint(supports)
    return Motion(name, len(times), tuple(drags), gravity, supports)


def _grab(grab: GrabSettings, time_step: float) -> Drag | None:
    path = Path.of([(keyframe.time, keyframe.target) for keyframe in grab.keyframes], grab.interpolation == "eased")
    return grab_along(path, grab.point, grab.radius, grab.stiffness, grab.at_rest, time_step)


def _support(scene: Scene, moving: MovingPinsSettings, times: Array) -> Support:
    place = region(moving.where)
    vertices = np.flatnonzero(vertices_in(place, scene.mesh, "moves") & scene.pinned)
    if len(vertices) == 0:
        raise MotionError(f"{place} holds no pinned vertex; only pins can follow a path, so pin them (mesh.pins)")
    centre = scene.mesh.vertices[vertices].mean(axis=0) if moving.centre is None else moving.centre
    poses = [(keyframe.time, (*keyframe.translation, np.radians(keyframe.angle))) for keyframe in moving.keyframes]
    return support_along(Path.of(poses, moving.interpolation == "eased"), vertices, centre, moving.axis, times)


def _check_disjoint(supports: tuple[Support, ...]) -> None:
    moved = np.concatenate([np.empty(0, dtype=np.int64), *(support.vertices for support in supports)])
    vertices, counts = np.unique(moved, return_counts=True)
    if (counts > 1).any():
        raise MotionError(
            f"vertex {vertices[counts.argmax()]} follows two paths; regions of moving_pins must not overlap"
        )


def _sweep(name: str, scene: Scene, sweep: GravitySweepSettings) -> Motion:
    g = scene.gravity if scene.gravity.any() or sweep.size is None else np.array([0.0, -1.0, 0.0])
    start = g if sweep.size is None else g * (sweep.size / np.linalg.norm(g))
    frames = frames_until(sweep.duration, scene.time_step)
    return Motion(name, frames, gravity=gravity_sweep(start, frames, sweep.turns))


def _release(name: str, scene: Scene, release: ReleaseSettings) -> Motion:
    there, let_go = release.pull, release.pull + release.hold
    held = [(0.0, release.point), (there, release.target), (let_go, release.target)]
    path = Path.of(held if release.hold > 0 else held[:2], eased=True)
    drag = grab_along(path, release.point, release.radius, release.stiffness, True, scene.time_step)
    return Motion(name, frames_until(let_go + release.swing, scene.time_step), () if drag is None else (drag,))
