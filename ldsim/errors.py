"""What can go wrong for a user: every subclass becomes one line on stderr and exit status 1."""

from __future__ import annotations

# Exit status of what Ctrl+C ended, as shells have it: 128 and the number of the signal.
INTERRUPTED = 130


class StageInterrupted(KeyboardInterrupt):
    """Ctrl+C ended a stage, which has told of it; no failure that whoever calls could go on after."""


class LdsimError(Exception):
    """Something the user can act on; the message names the thing, what was got, what is allowed."""


class MeshError(LdsimError):
    """A mesh, or the file it comes from, cannot be simulated."""


class SceneError(LdsimError):
    """Material, pins or loads do not make a well-posed problem."""


class MotionError(LdsimError):
    """A recorded or prescribed motion does not fit the scene."""


class SolverError(LdsimError):
    """A time step or a fit could not be solved."""


class LostMotionError(SolverError):
    """A step of a motion has no solution in the full space, mostly because a cell is inverted."""


class SettingsError(LdsimError):
    """A configuration file is missing, malformed or holds a value that is not allowed."""


class ArtefactError(LdsimError):
    """An HDF5 artefact is missing, truncated, of another kind or of another experiment."""


class ExportError(LdsimError):
    """A run cannot be written in the wanted format, motion or space."""
