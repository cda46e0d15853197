"""An experiment: the options of its stages, put together and read from YAML, and what of a run is stale.

Every option is declared in the room that uses it; the reference page of the docs, `ldsim settings` and the messages
about unknown keys all come from these declarations.
"""

from ldsim.settings.experiment import STAGES, Settings, load_settings, settings_of

__all__ = ["STAGES", "Settings", "load_settings", "settings_of"]
