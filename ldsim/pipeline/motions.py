"""The motions of the section `snapshot`, made for a scene."""

from __future__ import annotations

from pathlib import Path

from ldsim.errors import LdsimError
from ldsim.mechanics.motion import Motion
from ldsim.mechanics.options import ScriptOptions
from ldsim.mechanics.random_pulls import surface_pulls
from ldsim.mechanics.recording import read_recording
from ldsim.mechanics.scene import Scene
from ldsim.mechanics.script import released, scripted, swept
from ldsim.options import read_options
from ldsim.pipeline.files import resolve_path
from ldsim.pipeline.options import MotionOptions


def motion(scene: Scene, options: MotionOptions, base: Path = Path()) -> Motion:
    """The motion that the options describe, for a scene.

    Args:
        base: the folder to which the files of the options are relative.

    Raises:
        LdsimError: naming the motion.
    """
    try:
        whole = _motion(scene, options, base)
    except LdsimError as error:
        raise type(error)(f"motion {options.name}: {error}") from error
    return whole if options.frames is None else whole.first(options.frames)


def _motion(scene: Scene, options: MotionOptions, base: Path) -> Motion:
    name = options.name
    if options.recording is not None:
        return read_recording(resolve_path(options.recording, base), name)
    if options.pulls is not None:
        return surface_pulls(name, scene, options.pulls)
    if options.script is not None:
        return scripted(name, scene, options.script)
    if options.script_file is not None:
        return scripted(name, scene, read_options(resolve_path(options.script_file, base), "script", ScriptOptions))
    if options.gravity_sweep is not None:
        return swept(name, scene, options.gravity_sweep)
    assert options.release is not None
    return released(name, scene, options.release)
