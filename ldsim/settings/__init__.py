"""Every setting, declared once: type, default, range, unit and a sentence. The only importer of yaml.

The reference page of the docs, `ldsim settings` and the messages about unknown keys all come from these declarations:
`scene` has the section `mesh`, `motions` what the section `snapshot` runs, `experiment` the other sections.
"""

from ldsim.settings.experiment import STAGES, CubatureSettings, Settings, SnapshotSettings
from ldsim.settings.files import DATA_VARIABLE, input_files, resolve_path, stage_settings, stamp
from ldsim.settings.motions import (
    GrabSettings,
    GravitySweepSettings,
    MotionSettings,
    MovingPinsSettings,
    ReleaseSettings,
    ScriptSettings,
)
from ldsim.settings.reading import dump, load_script, load_settings, settings_of
from ldsim.settings.scene import MeshSettings, RegionSettings, ShapeSettings, SurfaceSettings

__all__ = [
    "DATA_VARIABLE",
    "STAGES",
    "CubatureSettings",
    "GrabSettings",
    "GravitySweepSettings",
    "MeshSettings",
    "MotionSettings",
    "MovingPinsSettings",
    "RegionSettings",
    "ReleaseSettings",
    "ScriptSettings",
    "Settings",
    "ShapeSettings",
    "SnapshotSettings",
    "SurfaceSettings",
    "dump",
    "input_files",
    "load_script",
    "load_settings",
    "resolve_path",
    "settings_of",
    "stage_settings",
    "stamp",
]
