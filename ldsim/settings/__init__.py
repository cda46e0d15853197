"""An experiment: the options of its stages, put together, read from YAML, and stamped for make.

Every option is declared in the room that uses it; the reference page of the docs, `ldsim settings` and the messages
about unknown keys all come from these declarations.
"""

from ldsim.settings.experiment import STAGES, Settings, load_settings, settings_of
from ldsim.settings.files import input_files, stamp, write_stamps

__all__ = [
    "STAGES",
    "Settings",
    "input_files",
    "load_settings",
    "settings_of",
    "stamp",
    "write_stamps",
]
